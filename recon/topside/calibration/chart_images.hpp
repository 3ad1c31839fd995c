#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/calibration/colour_chart.hpp"
#include "recon/import/images/image_samples.hpp"

namespace fathom::topside {

// Outer corners of the patches dark skin, bluish green, black and white, as u, v [px].
using ChartCorners = std::array<Eigen::Vector2d, 4>;

// Reads what the camera saw on the patches of every colour chart in an image, in linear light (RGB of 8 bits
// is taken to be sRGB). Charts in any orientation are found (chart_finder.hpp) where their colours agree with
// the known ones, or one is read between given corners. Throws InputError, which names the file: no colours,
// no chart, most patches clipped, corners outside or of something else.
[[nodiscard]] std::vector<calibration::ChartView> readCharts(const std::filesystem::path& file,
                                                             Samples samples,
                                                             const std::optional<ChartCorners>& corners);

}  // namespace fathom::topside

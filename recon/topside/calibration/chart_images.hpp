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

// Reads an image of a colour chart and what the camera saw on its patches, in linear light (RGB of 8 bits is
// taken to be sRGB). The chart is found by OpenCV (mcc) unless its corners are given. Throws InputError,
// which names the file: no colours, no chart, corners outside.
[[nodiscard]] calibration::ChartView readChart(const std::filesystem::path& file, Samples samples,
                                               const std::optional<ChartCorners>& corners);

}  // namespace fathom::topside

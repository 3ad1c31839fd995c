#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

namespace fathom::calibration {

// The 24 patches of the usual colour chart, row after row of six, from dark skin to black.
inline constexpr int kChartColumns = 6, kChartRows = 4, kPatches = kChartColumns * kChartRows;
[[nodiscard]] const char* patchName(int patch);
// Linear sRGB (D65), 0 to 1, of the published sRGB values.
[[nodiscard]] Eigen::Vector3d patchColour(int patch);

// Samples of one chart: means in linear light, any scale; none: clipped or not visible.
struct ChartView {
  std::string name;
  std::array<std::optional<Eigen::Vector3d>, kPatches> patches;
};

// Matrix from a camera's colours, white-balanced, to linear sRGB. Rows add up to 1, so that grey stays grey:
// the white balance is the dive's, and one chart at one place does not determine it.
struct ColourCalibration {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  // CIEDE2000 by patch, with the white balance alone and with the matrix; mean over views, NaN without any.
  std::array<double, kPatches> before{}, after{};
  double median_before = 0, median_after = 0, worst_after = 0;
};

// Alternates least squares for each view's white balance and plane of uneven light (in logarithms) and for
// one matrix of all views; patches weigh by the inverse of their lightness. Throws InputError, which names
// `source`, where a view has fewer than kFewestPatches.
[[nodiscard]] ColourCalibration calibrateColours(const std::vector<ChartView>& views,
                                                 const std::string& source);
inline constexpr int kFewestPatches = 12;

}  // namespace fathom::calibration

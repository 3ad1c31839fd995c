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
  bool rendered = false;  // by the camera, in 8 bits: its tone curve is not that of sRGB exactly
  std::array<std::optional<Eigen::Vector3d>, kPatches> patches;
};

// How well a chart's colours agree with the known ones: share of the variance of the samples' square roots
// that an affine map of the known ones explains, mean of the two better channels. A wrong place or
// orientation stays below kAgrees. std::nullopt with fewer than kFewestPatches.
[[nodiscard]] std::optional<double> agreementOf(const ChartView& view);
inline constexpr double kAgrees = 0.7;
inline constexpr int kFewestPatches = 12;

// Matrix from a camera's colours, white-balanced, to linear sRGB. Rows add up to 1, so that grey stays grey:
// the white balance is the dive's, and one chart at one place does not determine it.
struct ColourCalibration {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  // CIEDE2000 by patch, with the views' balances alone and with the matrix; mean over views, NaN without any.
  std::array<double, kPatches> before{}, after{};
  double median_before = 0, median_after = 0, worst_after = 0;
  // Medians over patches, each by a fit of all the others.
  double held_before = 0, held_after = 0;
};

// Robust least squares in CIELAB of one matrix of all views with, of each view, the backscatter and gain of
// each channel, light and backscatter that vary over the chart (in logarithms, as a quadric and linearly)
// and, of rendered images, the exponent of the tone curve. Throws InputError, which names `source`, where
// a view has fewer than kFewestPatches, and where the matrix leaves patches that had no part in it worse than
// the views' balances alone, or farther off than 12 (median CIEDE2000).
[[nodiscard]] ColourCalibration calibrateColours(const std::vector<ChartView>& views,
                                                 const std::string& source);

}  // namespace fathom::calibration

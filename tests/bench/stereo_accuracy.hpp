#pragma once

#include <string>
#include <vector>

#include "tests/bench/common/true_mission.hpp"

namespace fathom::stereo {

// One matched point against the truth.
struct PointError {
  double depth = 0;      // true, along z [m]
  double height = 0;     // z minus the true z [m]
  double disparity = 0;  // right column minus the true one [px]
  double sigma = 0;      // as reported, along z [m]; 0: not reported
};

// Adds the errors of one result; points that see past the terrain are passed over.
void addErrors(const bench::TrueMission& mission, std::size_t pair, const StereoResult& result,
               std::vector<PointError>& errors);

struct Accuracy {
  std::size_t points = 0;
  double median = 0, p90 = 0, p99 = 0;  // of |disparity| [px]
  double bias = 0;                      // median of the signed disparity error [px]
  double beyond_1px = 0;                // share
  double outliers = 0;                  // share with |height| > 3 sigma + 1 cm
  // Root mean square of height / sigma over the rest: 1 if sigma is right, above 1 if it is too small.
  double error_over_sigma = 0;
  // The same for quarters of the points by rising sigma.
  std::vector<double> error_over_sigma_by_sigma;
};
[[nodiscard]] Accuracy accuracyOf(std::vector<PointError> errors);

// A depth image of triangles between pixels of the left image, every `step` pixels; 0: not covered. Inverse
// depth is interpolated, which is linear in the image.
[[nodiscard]] std::vector<float> depthImage(const std::vector<Eigen::Vector2d>& pixels,
                                            const std::vector<double>& depth,
                                            const std::vector<std::array<std::uint32_t, 3>>& triangles,
                                            int width, int height, int step);
// Root mean square difference where both are covered [m].
[[nodiscard]] double rmsDifference(const std::vector<float>& a, const std::vector<float>& b);

}  // namespace fathom::stereo

#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/bench/common/measures.hpp"
#include "tests/bench/common/true_mission.hpp"

namespace fathom::stereo {

// One matched point against the truth.
struct PointError {
  double depth = 0;      // true, along z [m]
  double height = 0;     // z minus the true z [m]
  double disparity = 0;  // right column minus the true one [px]
  double sigma = 0;      // as reported, along z [m]; 0: not reported
};

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

// Adds the errors of one result; points that see past the terrain are passed over.
inline void addErrors(const bench::TrueMission& mission, std::size_t pair, const StereoResult& result,
                      std::vector<PointError>& errors) {
  for (const StereoPoint& p : result.points) {
    const auto truth = mission.pointAt(pair, p.left.cast<double>());
    if (!truth) continue;
    const Eigen::Vector2d right = mission.rig().right.project(mission.rig().T_right_left * *truth);
    errors.push_back({truth->z(), static_cast<double>(p.point.z()) - truth->z(),
                      static_cast<double>(p.right.x()) - right.x(), static_cast<double>(p.sigma_z)});
  }
}

[[nodiscard]] inline Accuracy accuracyOf(std::vector<PointError> errors) {
  Accuracy a;
  a.points = errors.size();
  if (errors.empty()) return a;
  const auto n = static_cast<double>(errors.size());
  std::vector<double> magnitude, signed_error;
  for (const PointError& e : errors) {
    magnitude.push_back(std::abs(e.disparity));
    signed_error.push_back(e.disparity);
    a.beyond_1px += std::abs(e.disparity) > 1 ? 1 / n : 0;
  }
  a.median = bench::quantile(magnitude, 0.5);
  a.p90 = bench::quantile(magnitude, 0.9);
  a.p99 = bench::quantile(magnitude, 0.99);
  a.bias = bench::quantile(signed_error, 0.5);
  if (!(errors.front().sigma > 0)) return a;

  constexpr double kSigmas = 3, kAllowance = 0.01;  // of an outlier; [m]
  std::sort(errors.begin(), errors.end(),
            [](const PointError& x, const PointError& y) { return x.sigma < y.sigma; });
  constexpr std::size_t kBins = 4;
  std::array<double, kBins> squares{}, counts{};
  for (std::size_t i = 0; i < errors.size(); ++i) {
    const PointError& e = errors[i];
    if (std::abs(e.height) > kSigmas * e.sigma + kAllowance) {
      a.outliers += 1 / n;
      continue;
    }
    const std::size_t bin = i * kBins / errors.size();
    squares[bin] += e.height / e.sigma * (e.height / e.sigma);
    counts[bin] += 1;
  }
  double sum = 0, count = 0;
  for (std::size_t b = 0; b < kBins; ++b) {
    sum += squares[b];
    count += counts[b];
    a.error_over_sigma_by_sigma.push_back(std::sqrt(squares[b] / std::max(counts[b], 1.0)));
  }
  a.error_over_sigma = std::sqrt(sum / std::max(count, 1.0));
  return a;
}

// A depth image of triangles between pixels of the left image, every `step` pixels; 0: not covered. Inverse
// depth is interpolated, which is linear in the image.
[[nodiscard]] inline std::vector<float> depthImage(const std::vector<Eigen::Vector2d>& pixels,
                                                   const std::vector<double>& depth,
                                                   const std::vector<std::array<std::uint32_t, 3>>& triangles,
                                                   int width, int height, int step) {
  const int columns = (width + step - 1) / step, rows = (height + step - 1) / step;
  std::vector<float> image(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), 0.0F);
  const auto cross = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() * b.y() - a.y() * b.x();
  };
  for (const auto& t : triangles) {
    const Eigen::Vector2d &a = pixels[t[0]], &b = pixels[t[1]], &c = pixels[t[2]];
    const double area = cross(b - a, c - a);
    if (area == 0) continue;
    const Eigen::Vector2d low = a.cwiseMin(b).cwiseMin(c) / step, high = a.cwiseMax(b).cwiseMax(c) / step;
    for (int y = std::max(0, static_cast<int>(std::ceil(low.y())));
         y <= std::min(rows - 1, static_cast<int>(high.y())); ++y) {
      for (int x = std::max(0, static_cast<int>(std::ceil(low.x())));
           x <= std::min(columns - 1, static_cast<int>(high.x())); ++x) {
        const Eigen::Vector2d p(x * step, y * step);
        const double u = cross(b - p, c - p) / area, v = cross(c - p, a - p) / area, w = 1 - u - v;
        if (u < 0 || v < 0 || w < 0) continue;
        image[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(x)] =
            static_cast<float>(1.0 / (u / depth[t[0]] + v / depth[t[1]] + w / depth[t[2]]));
      }
    }
  }
  return image;
}

// Root mean square difference where both are covered [m].
[[nodiscard]] inline double rmsDifference(const std::vector<float>& a, const std::vector<float>& b) {
  double squares = 0, count = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    if (a[i] == 0 || b[i] == 0) continue;
    squares += static_cast<double>(a[i] - b[i]) * static_cast<double>(a[i] - b[i]);
    count += 1;
  }
  return count > 0 ? std::sqrt(squares / count) : 0;
}

}  // namespace fathom::stereo

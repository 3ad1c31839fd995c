#include "recon/closure/stereo_match.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "recon/closure/patch_alignment.hpp"

namespace fathom::closure {
namespace {

constexpr int kMaxWindow = PatchAligner::kMostWindow;
constexpr int kMaxSteps = 1024;  // along one epipolar line
constexpr int kPeakRadius = 3;   // steps about the best that are the same peak

// Zero-mean window of whole pixels.
struct Window {
  std::array<float, kMaxWindow * kMaxWindow> values;
  double norm = 0;
};

bool takeTemplate(const ImageView& image, int x, int y, int half, Window& window) {
  double sum = 0, squares = 0;
  std::size_t n = 0;
  for (int j = -half; j <= half; ++j) {
    const std::uint8_t* row = rowOf(image, y + j) + x;
    for (int i = -half; i <= half; ++i) {
      window.values[n++] = row[i];
      sum += row[i];
      squares += row[i] * row[i];
    }
  }
  const double mean = sum / static_cast<double>(n), power = squares - sum * mean;
  for (std::size_t k = 0; k < n; ++k) window.values[k] -= static_cast<float>(mean);
  window.norm = std::sqrt(std::max(power, 0.0));
  return power > kFlatVariance * static_cast<double>(n);
}

double correlation(const Window& window, const ImageView& image, int x, int y, int half) {
  float cross = 0;
  int sum = 0, squares = 0;
  const float* value = window.values.data();
  for (int j = -half; j <= half; ++j) {
    const std::uint8_t* row = rowOf(image, y + j) + x;
    for (int i = -half; i <= half; ++i) {
      const int v = row[i];
      cross += *value++ * static_cast<float>(v);
      sum += v;
      squares += v * v;
    }
  }
  const int n = (2 * half + 1) * (2 * half + 1);
  const double power = squares - static_cast<double>(sum) * sum / n;
  if (power <= kFlatVariance * n) return 0;
  return static_cast<double>(cross) / (window.norm * std::sqrt(power));
}

}  // namespace

bool StereoMatcher::search(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                           const DepthRange& depths, Eigen::Vector2d& right_pixel) const {
  const int half = config_.search_window / 2;
  if (!holdsWindow(left, left_pixel, half)) return false;
  Window window;
  if (!takeTemplate(left, static_cast<int>(std::lround(left_pixel.x())),
                    static_cast<int>(std::lround(left_pixel.y())), half, window))
    return false;
  const Eigen::Vector3d ray = rig_.T_right_left.rotation() * rig_.left.ray(left_pixel);
  const Eigen::Vector3d& t = rig_.T_right_left.translation();
  const double near = 1 / depths.nearest, far = 1 / depths.farthest;
  const auto there = [&](double inverse_depth) { return projectAt(rig_.right, ray, t, inverse_depth); };
  if (ray.z() + near * t.z() <= 0 || ray.z() + far * t.z() <= 0) return false;
  const double length = (there(near) - there(far)).norm();
  const int steps = std::clamp(static_cast<int>(std::ceil(length)), 1, kMaxSteps);
  std::vector<double> scores(static_cast<std::size_t>(steps) + 1, 0.0);
  int best = -1;
  for (int k = 0; k <= steps; ++k) {
    const Eigen::Vector2d p = there(far + (near - far) * k / steps);
    if (!holdsWindow(right, p, half)) continue;
    const auto at = static_cast<std::size_t>(k);
    scores[at] = correlation(window, right, static_cast<int>(std::lround(p.x())),
                             static_cast<int>(std::lround(p.y())), half);
    if (best < 0 || scores[at] > scores[static_cast<std::size_t>(best)]) {
      best = k;
      right_pixel = p;
    }
  }
  if (best < 0 || scores[static_cast<std::size_t>(best)] < config_.min_correlation) return false;
  for (int k = 0; k <= steps; ++k) {
    if (std::abs(k - best) > kPeakRadius &&
        scores[static_cast<std::size_t>(k)] >
            config_.max_second_peak * scores[static_cast<std::size_t>(best)])
      return false;
  }
  return true;
}

bool StereoMatcher::refine(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                           StereoMatch& found) const {
  constexpr double kMaxShift = 2.5;  // from where the search ended [px]
  PatchAligner aligner(config_.refine_window);
  return aligner.take(left, left_pixel) && aligner.find(right, kMaxShift, found.right, found.covariance);
}

bool StereoMatcher::match(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                          const DepthRange& depths, StereoMatch& found) const {
  if (!search(left, right, left_pixel, depths, found.right) || !refine(left, right, left_pixel, found))
    return false;
  double gap = 0;
  if (!triangulatePixels(rig_, left_pixel, found.right, found.point, gap)) return false;
  if (found.point.z() < depths.nearest || found.point.z() > depths.farthest) return false;
  return gap * rig_.left.fx / found.point.z() <= config_.max_epipolar_distance;
}

Eigen::Matrix3d StereoMatcher::pointCovariance(const Eigen::Vector2d& left_pixel, const StereoMatch& match,
                                               double sigma_place) const {
  constexpr double kStep = 1e-5;  // of a normalised image coordinate: a hundredth of a pixel
  const Eigen::Vector3d rays[2] = {rig_.left.ray(left_pixel), rig_.right.ray(match.right)};
  Eigen::Matrix<double, 3, 4> by_rays;
  for (int k = 0; k < 4; ++k) {
    Eigen::Vector3d point[2];
    for (int s = 0; s < 2; ++s) {
      Eigen::Vector3d moved[2] = {rays[0], rays[1]};
      moved[k / 2](k % 2) += s == 0 ? kStep : -kStep;
      double gap = 0;
      if (!triangulateMidpoint(rig_, moved[0], moved[1], point[s], gap)) return Eigen::Matrix3d::Zero();
    }
    by_rays.col(k) = (point[0] - point[1]) / (2 * kStep);
  }
  const Eigen::Matrix<double, 3, 2> by_left =
      by_rays.leftCols<2>() * rig_.left.pixelJacobian(rays[0].head<2>()).inverse();
  const Eigen::Matrix<double, 3, 2> by_right =
      by_rays.rightCols<2>() * rig_.right.pixelJacobian(rays[1].head<2>()).inverse();
  const Eigen::Matrix<double, 3, 2> by_both = by_left + by_right;
  // The floor keeps the covariance of full rank where a feature's place is certain.
  const double place = sigma_place * sigma_place + kMatchFloor_px * kMatchFloor_px;
  return place * by_both * by_both.transpose() + by_right * match.covariance * by_right.transpose();
}

}  // namespace fathom::closure

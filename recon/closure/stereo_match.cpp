#include "recon/closure/stereo_match.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace fathom::closure {
namespace {

constexpr double kEdge = 1e-3;  // determinant of H, by the square of its trace

double sample(const ImageView& image, double x, double y) {
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const double u = x - ix, v = y - iy;
  const std::uint8_t *a = rowOf(image, iy) + ix, *b = rowOf(image, iy + 1) + ix;
  return (1 - v) * ((1 - u) * a[0] + u * a[1]) + v * ((1 - u) * b[0] + u * b[1]);
}

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

const std::uint8_t* rowOf(const ImageView& image, int y) {
  return static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(y) * image.stride;
}

bool holdsWindow(const ImageView& image, const Eigen::Vector2d& pixel, double reach) {
  return pixel.x() >= reach + 1 && pixel.y() >= reach + 1 && pixel.x() < image.width - reach - 2 &&
         pixel.y() < image.height - reach - 2;
}

PatchAligner::PatchAligner(int window) : half_(window / 2), values_(window * window) {
  if (window < 3 || window > kMostWindow || window % 2 == 0)
    throw std::invalid_argument("patch alignment: the window must be odd, 3 to 31 px");
}

// Gradients g by central differences; mean and gain are projected out of them, so that H = sum g g^T and the
// step is H^-1 sum g (gain^-1 R - T).
bool PatchAligner::take(const ImageView& image, const Eigen::Vector2d& centre, const Eigen::Matrix2d& warp) {
  const double reach = (half_ + 1) * warp.cwiseAbs().rowwise().sum().maxCoeff() - 1;
  if (!holdsWindow(image, centre, reach)) return false;
  const auto seen = [&](double x, double y) {
    const Eigen::Vector2d p = centre + warp * Eigen::Vector2d(x, y);
    return sample(image, p.x(), p.y());
  };
  const int side = 2 * half_ + 1;
  double mean = 0;
  Eigen::Vector2d gradient_mean = Eigen::Vector2d::Zero();
  for (int k = 0; k < values_; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const int x = k % side - half_, y = k / side - half_;
    model_[at] = seen(x, y);
    gradient_[at] = 0.5 * Eigen::Vector2d(seen(x + 1, y) - seen(x - 1, y), seen(x, y + 1) - seen(x, y - 1));
    mean += model_[at] / values_;
    gradient_mean += gradient_[at] / values_;
  }
  power_ = 0;
  Eigen::Vector2d along = Eigen::Vector2d::Zero();
  for (int k = 0; k < values_; ++k) {
    const auto at = static_cast<std::size_t>(k);
    model_[at] -= mean;
    gradient_[at] -= gradient_mean;
    power_ += model_[at] * model_[at];
    along += model_[at] * gradient_[at];
  }
  if (power_ <= kFlatVariance * values_) return false;
  Eigen::Matrix2d h = Eigen::Matrix2d::Zero();
  for (int k = 0; k < values_; ++k) {
    const auto at = static_cast<std::size_t>(k);
    gradient_[at] -= along / power_ * model_[at];
    h += gradient_[at] * gradient_[at].transpose();
  }
  if (h.determinant() < kEdge * h.trace() * h.trace()) return false;
  inverse_ = h.inverse();
  return true;
}

bool PatchAligner::find(const ImageView& image, double most_shift, Eigen::Vector2d& at,
                        Eigen::Matrix2d& covariance) const {
  constexpr int kMaxIterations = 12;
  constexpr double kConverged = 0.005;  // [px]
  constexpr double kLeastGain = 0.2;    // below, or negative: another place
  const int side = 2 * half_ + 1;
  const Eigen::Vector2d start = at;
  std::array<double, kMostValues> seen;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!holdsWindow(image, at, half_)) return false;
    double seen_mean = 0;
    for (int k = 0; k < values_; ++k) {
      double& value = seen[static_cast<std::size_t>(k)];
      const int column = k % side, row = k / side;
      value = sample(image, at.x() + column - half_, at.y() + row - half_);
      seen_mean += value / values_;
    }
    double gain = 0;
    for (std::size_t k = 0; k < static_cast<std::size_t>(values_); ++k)
      gain += (seen[k] - seen_mean) * model_[k] / power_;
    if (gain < kLeastGain) return false;
    Eigen::Vector2d b = Eigen::Vector2d::Zero();
    double residual = 0;
    for (std::size_t k = 0; k < static_cast<std::size_t>(values_); ++k) {
      const double e = (seen[k] - seen_mean) / gain - model_[k];
      b += e * gradient_[k];
      residual += e * e;
    }
    const Eigen::Vector2d step = inverse_ * b;
    at -= step;
    if (!((at - start).norm() < most_shift)) return false;
    if (step.norm() < kConverged) {
      covariance =
          residual / (values_ - 4) * inverse_ + kMatchFloor_px * kMatchFloor_px * Eigen::Matrix2d::Identity();
      return true;
    }
  }
  return false;
}

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

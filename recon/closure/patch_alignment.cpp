#include "recon/closure/patch_alignment.hpp"

#include <Eigen/Dense>
#include <stdexcept>

namespace fathom::closure {
namespace {

constexpr double kEdge = 1e-3;  // determinant of H, by the square of its trace

double sample(const ImageView& image, double x, double y) {
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const double u = x - ix, v = y - iy;
  const std::uint8_t *a = rowOf(image, iy) + ix, *b = rowOf(image, iy + 1) + ix;
  return (1 - v) * ((1 - u) * a[0] + u * a[1]) + v * ((1 - u) * b[0] + u * b[1]);
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
    const double x = k % side - half_, y = k / side - half_;
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
      value = sample(image, at.x() + k % side - half_, at.y() + k / side - half_);
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

}  // namespace fathom::closure

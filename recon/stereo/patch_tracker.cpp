#include "recon/stereo/patch_tracker.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>

namespace fathom::stereo {
namespace {

constexpr int kFineIterations = 12;  // at the full resolution; 3 to 5 are usual
constexpr int kCoarseIterations = 5;
constexpr double kFineTolerance = 0.01;   // last step [px], a tenth of a good match's error
constexpr double kCoarseTolerance = 0.1;  // last step [px of the level]
constexpr double kMaxStep = 2.0;          // one update [px of the level]: the linearisation holds no farther
constexpr double kMaxDrift = 6.0;         // from where a level began [px of the level]
// Of the Gaussian weights, in window edges: less noise than a narrower one, fewer errors beside a step in
// depth than equal weights (a quarter fewer beyond 1 px on the Middlebury pair, for a fifth more noise on a
// plane).
constexpr double kWindowSigma = 0.25;
constexpr float kMinEnergy = 0.25;  // variance of a window worth tracking [grey levels squared]
constexpr double kMinHessian =
    1e-3;  // smaller eigenvalue, mean squared gradient [grey levels a pixel, squared]

}  // namespace

PatchTracker::PatchTracker(int window) : window_(window), half_(window / 2) {
  const double sigma = kWindowSigma * window;
  double sum = 0;
  for (int j = -half_; j <= half_; ++j)
    for (int i = -half_; i <= half_; ++i) sum += std::exp(-(i * i + j * j) / (2 * sigma * sigma));
  float* weight = weight_.data();
  for (int j = -half_; j <= half_; ++j)
    for (int i = -half_; i <= half_; ++i)
      *weight++ = static_cast<float>(std::exp(-(i * i + j * j) / (2 * sigma * sigma)) / sum);
}

bool PatchTracker::inside(const GrayLevel& level, const Eigen::Vector2d& at) const {
  return at.x() >= 0 && at.y() >= 0 && at.x() <= level.width() - 1 && at.y() <= level.height() - 1;
}

void PatchTracker::sample(const GrayLevel& level, const Eigen::Vector2d& at, int edge, float* out) const {
  const double left = at.x() - edge / 2, top = at.y() - edge / 2;
  const int x0 = static_cast<int>(std::floor(left)), y0 = static_cast<int>(std::floor(top));
  const auto fx = static_cast<float>(left - x0), fy = static_cast<float>(top - y0);
  const float w00 = (1 - fx) * (1 - fy), w01 = fx * (1 - fy), w10 = (1 - fx) * fy, w11 = fx * fy;
  for (int j = 0; j < edge; ++j) {
    const std::uint8_t* a = level.row(y0 + j) + x0;
    const std::uint8_t* b = a + level.stride();
#pragma omp simd
    for (int i = 0; i < edge; ++i)
      out[i] = w00 * static_cast<float>(a[i]) + w01 * static_cast<float>(a[i + 1]) +
               w10 * static_cast<float>(b[i]) + w11 * static_cast<float>(b[i + 1]);
    out += edge;
  }
}

bool PatchTracker::makeTemplate(const GrayLevel& level, const Eigen::Vector2d& at) {
  const int padded = window_ + 2, n = window_ * window_;
  sample(level, at, padded, patch_.data());
  Template& t = template_;
  float mean = 0, mean_x = 0, mean_y = 0;
  for (int j = 0; j < window_; ++j) {
    const float* middle = patch_.data() + (j + 1) * padded + 1;
#pragma omp simd reduction(+ : mean, mean_x, mean_y)
    for (int i = 0; i < window_; ++i) {
      const int k = j * window_ + i;
      const float w = weight_[k];
      t.value[k] = middle[i];
      t.sx[k] = 0.5F * (middle[i + 1] - middle[i - 1]);
      t.sy[k] = 0.5F * (middle[i + padded] - middle[i - padded]);
      mean += w * t.value[k];
      mean_x += w * t.sx[k];
      mean_y += w * t.sy[k];
    }
  }
  float energy = 0, along_x = 0, along_y = 0;
#pragma omp simd reduction(+ : energy, along_x, along_y)
  for (int k = 0; k < n; ++k) {
    const float centred = t.value[k] - mean;
    energy += weight_[k] * centred * centred;
    along_x += weight_[k] * centred * t.sx[k];
    along_y += weight_[k] * centred * t.sy[k];
  }
  if (energy < kMinEnergy) return false;
  const float per_x = along_x / energy, per_y = along_y / energy;
  float xx = 0, xy = 0, yy = 0;
#pragma omp simd reduction(+ : xx, xy, yy)
  for (int k = 0; k < n; ++k) {
    const float centred = t.value[k] - mean;
    const float gx = t.sx[k] - mean_x - per_x * centred, gy = t.sy[k] - mean_y - per_y * centred;
    const float w = weight_[k];
    xx += w * gx * gx;
    xy += w * gx * gy;
    yy += w * gy * gy;
    t.value[k] = w * centred;
    t.sx[k] = w * gx;
    t.sy[k] = w * gy;
  }
  const double determinant = static_cast<double>(xx) * yy - static_cast<double>(xy) * xy;
  if (determinant < kMinHessian * (xx + yy)) return false;
  Eigen::Matrix2d hessian;
  hessian << xx, xy, xy, yy;
  t.inverse_hessian = hessian.inverse();
  t.energy = energy;
  return true;
}

double PatchTracker::correlation(const float* values) const {
  float mean = 0, square = 0, common = 0;
#pragma omp simd reduction(+ : mean, square, common)
  for (int k = 0; k < window_ * window_; ++k) {
    mean += weight_[k] * values[k];
    square += weight_[k] * values[k] * values[k];
    common += template_.value[k] * values[k];
  }
  const double energy = static_cast<double>(square) - static_cast<double>(mean) * mean;
  return energy < kMinEnergy ? 0.0 : common / std::sqrt(energy * template_.energy);
}

Eigen::Vector2d PatchTracker::search(const GrayLevel& level, double scale,
                                     std::span<const Eigen::Vector2d> candidates, double& best) {
  Eigen::Vector2d found = Eigen::Vector2d::Zero();
  best = 0;
  for (const Eigen::Vector2d& candidate : candidates) {
    // Whole pixels are near enough to start from, and need no interpolation.
    const Eigen::Vector2d p = (candidate * scale).array().round();
    if (!inside(level, p)) continue;
    float* out = patch_.data();
    for (int j = -half_; j <= half_; ++j) {
      const std::uint8_t* in = level.row(static_cast<int>(p.y()) + j) + static_cast<int>(p.x()) - half_;
#pragma omp simd
      for (int i = 0; i < window_; ++i) out[i] = static_cast<float>(in[i]);
      out += window_;
    }
    const double likeness = correlation(patch_.data());
    if (likeness > best) {
      best = likeness;
      found = p;
    }
  }
  return found;
}

bool PatchTracker::refine(const GrayLevel& level, Eigen::Vector2d& at, int iterations, double tolerance,
                          double& likeness) {
  const Eigen::Vector2d start = at;
  for (int k = 0; k < iterations; ++k) {
    sample(level, at, window_, patch_.data());
    float common = 0, bx = 0, by = 0;
#pragma omp simd reduction(+ : common, bx, by)
    for (int i = 0; i < window_ * window_; ++i) {
      const float v = patch_[i];
      common += template_.value[i] * v;
      bx += template_.sx[i] * v;
      by += template_.sy[i] * v;
    }
    const double gain = common / template_.energy;
    constexpr double kMinGain = 0.05;  // right over left brightness; less is no likeness
    if (gain < kMinGain) return false;
    Eigen::Vector2d step = template_.inverse_hessian * Eigen::Vector2d(bx, by) / -gain;
    const double length = step.norm();
    if (length > kMaxStep) step *= kMaxStep / length;
    at += step;
    if (!inside(level, at) || (at - start).norm() > kMaxDrift) return false;
    if (length < tolerance) break;
  }
  sample(level, at, window_, patch_.data());
  likeness = correlation(patch_.data());
  return true;
}

PatchMatch PatchTracker::track(const GrayPyramid& source, const Eigen::Vector2d& at,
                               const GrayPyramid& target, std::span<const Eigen::Vector2d> candidates) {
  PatchMatch match;
  const int top = source.levels() - 1;
  double scale = 1.0 / (1 << top);
  if (candidates.empty() || !makeTemplate(source.level(top), at * scale)) return match;
  double best = 0;
  Eigen::Vector2d position = search(target.level(top), scale, candidates, best);
  if (best <= 0) return match;
  for (int l = top; l >= 0; --l) {
    if (l < top) {
      position *= 2.0;
      scale *= 2.0;
      if (!makeTemplate(source.level(l), at * scale)) return match;
    }
    const bool fine = l == 0;
    if (!refine(target.level(l), position, fine ? kFineIterations : kCoarseIterations,
                fine ? kFineTolerance : kCoarseTolerance, match.correlation))
      return match;
  }
  match.position = position;
  match.found = true;
  return match;
}

}  // namespace fathom::stereo

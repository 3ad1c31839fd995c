#include "recon/stereo/patch_tracker.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>

namespace fathom::stereo {
namespace {

constexpr double kFineTolerance = 0.01;   // last step [px], a fifth of a good match's error
constexpr double kCoarseTolerance = 0.1;  // last step [px of the level]
constexpr double kMaxStep = 2.0;          // one update [px of the level]: the linearisation holds no farther
constexpr double kMostFromStart = 6.0;    // from where a level began [px of the level]
// Of the Gaussian weights, in window edges: less noise than a narrower one, fewer errors beside a step in
// depth than equal weights (a quarter fewer beyond 1 px on the Middlebury pair, for a fifth more noise on
// a plane).
constexpr double kWindowSigma = 0.25;
constexpr double kMinEnergy = 0.25;  // least variance of a window [grey levels squared]
// Smaller eigenvalue of the Hessian [grey levels a pixel, squared].
constexpr double kMinHessian = 1e-3;
constexpr double kMinGain = 0.05;  // right over left brightness; less is no match

constexpr double kSubpixels = 1 << kPositionBits;
constexpr double kGain2 = static_cast<double>(kSampleGain) * kSampleGain;
constexpr double kGradientStep = 2.0;  // a central difference spans two pixels
// The sum of a form's magnitudes times half a sample's largest value (255 grey levels) fits 32 bits.
constexpr double kMaxFormSum = 1 << 18;
constexpr double kMaxForm = 32000.0;  // fits 16 bits with the correction that makes the sum zero

}  // namespace

struct PatchTracker::Place {
  const std::uint8_t* origin;
  std::ptrdiff_t stride;
  int fx, fy;
  Eigen::Vector2d position;  // rounded to the lattice [px]
};

PatchTracker::PatchTracker(int window, const Kernels& kernels) : kernels_(&kernels), half_(window / 2) {
  constexpr int kLanes = 16;
  const int pitch = (window + kLanes - 1) / kLanes * kLanes;
  shape_ = {window, pitch, weight_.data(), search_weight_.data()};
  weight_.fill(0.0F);
  search_weight_.fill(0);
  padded_.fill(0);
  const double sigma = kWindowSigma * window;
  const auto gauss = [&](int x, int y) { return std::exp(-(x * x + y * y) / (2 * sigma * sigma)); };
  double sum = 0;
  for (int j = -half_; j <= half_; ++j)
    for (int i = -half_; i <= half_; ++i) sum += gauss(i, j);
  for (int j = -half_; j <= half_; ++j) {
    for (int i = -half_; i <= half_; ++i) {
      const auto k = static_cast<std::size_t>((j + half_) * pitch + i + half_);
      weight_[k] = static_cast<float>(gauss(i, j) / sum);
      search_weight_[k] = static_cast<std::int16_t>(std::lround(kSearchWeight * gauss(i, j)));
      search_weight_sum_ += search_weight_[k];
    }
  }
  // A form is w f, with sum(w f^2) = 1 before scaling: sum |w f| <= 1, and |w f| <= sqrt(largest w).
  form_scale_ = std::min(kMaxFormSum, kMaxForm * std::sqrt(sum));
}

bool PatchTracker::inside(const GrayLevel& level, const Eigen::Vector2d& at) const {
  return at.x() >= 0 && at.y() >= 0 && at.x() <= level.width() - 1 && at.y() <= level.height() - 1;
}

PatchTracker::Place PatchTracker::placeOf(const GrayLevel& level, const Eigen::Vector2d& at) const {
  const int x = static_cast<int>(std::floor(at.x() * kSubpixels + 0.5));
  const int y = static_cast<int>(std::floor(at.y() * kSubpixels + 0.5));
  constexpr int kMask = (1 << kPositionBits) - 1;
  return {level.row((y >> kPositionBits) - half_) + (x >> kPositionBits) - half_,
          level.stride(),
          x & kMask,
          y & kMask,
          {x / kSubpixels, y / kSubpixels}};
}

bool PatchTracker::makeTemplate(const GrayLevel& level, const Eigen::Vector2d& at) {
  const Place place = placeOf(level, at);
  kernels_->samplePatch(shape_, place.origin, place.stride, place.fx, place.fy, padded_.data());
  Template& t = template_;
  t.centre = padded_[static_cast<std::size_t>((half_ + 1) * (kPaddedPitch + 1))];
  PatchMoments m;
  kernels_->patchMoments(shape_, padded_.data(), t.centre, m);

  const double mean = m.v, mean_x = m.gx, mean_y = m.gy;
  t.energy = m.vv - mean * mean;
  if (!(t.energy >= kMinEnergy * kGain2)) return false;
  const double per_x = (m.vgx - mean * mean_x) / t.energy, per_y = (m.vgy - mean * mean_y) / t.energy;
  const double xx = m.gxgx - mean_x * mean_x - per_x * per_x * t.energy;
  const double xy = m.gxgy - mean_x * mean_y - per_x * per_y * t.energy;
  const double yy = m.gygy - mean_y * mean_y - per_y * per_y * t.energy;
  constexpr double kLeast = kMinHessian * kGain2 * kGradientStep * kGradientStep;
  const double determinant = xx * yy - xy * xy;
  if (!(xx > kLeast && yy > kLeast && determinant >= kLeast * (xx + yy))) return false;
  t.inverse_hessian << yy, -xy, -xy, xx;
  t.inverse_hessian *= kGradientStep * kGradientStep / determinant;

  t.scale_v = form_scale_ / std::sqrt(t.energy);
  t.scale_x = form_scale_ / std::sqrt(xx);
  t.scale_y = form_scale_ / std::sqrt(yy);
  const TemplateScaling scaling{t.centre,
                                m.v,
                                m.gx,
                                m.gy,
                                static_cast<float>(per_x),
                                static_cast<float>(per_y),
                                static_cast<float>(t.scale_v),
                                static_cast<float>(t.scale_x),
                                static_cast<float>(t.scale_y)};
  TemplateSums sums;
  kernels_->makeTemplate(shape_, padded_.data(), scaling, t.value.data(), t.sx.data(), t.sy.data(), sums);
  t.spread << sums.sxsx, sums.sxsy, sums.sxsy, sums.sysy;
  t.spread /= kGradientStep * kGradientStep;

  // Corrects the rounding: the middle sample makes the sums zero, and the forms' products with the template
  // are subtracted in every update.
  const auto middle = static_cast<std::size_t>(half_ * shape_.pitch + half_);
  const auto balance = [&](Forms& form, std::int32_t sum, std::int32_t with_sample) {
    form[middle] = static_cast<std::int16_t>(form[middle] - sum);
    return static_cast<double>(with_sample) - static_cast<double>(sum) * t.centre;
  };
  t.value_energy = balance(t.value, sums.value, sums.value_sample);
  t.along_x = balance(t.sx, sums.sx, sums.sx_sample) / t.value_energy;
  t.along_y = balance(t.sy, sums.sy, sums.sy_sample) / t.value_energy;
  return t.value_energy > 0;
}

double PatchTracker::correlation(const GrayLevel& level, const Eigen::Vector2d& at) const {
  const Place place = placeOf(level, at);
  Correlation sums;
  kernels_->correlate(shape_, place.origin, place.stride, place.fx, place.fy, template_.centre,
                      template_.value.data(), sums);
  const double energy =
      static_cast<double>(sums.square) - static_cast<double>(sums.mean) * static_cast<double>(sums.mean);
  if (energy < kMinEnergy * kGain2) return 0.0;
  return sums.cross / template_.scale_v / std::sqrt(energy * template_.energy);
}

Eigen::Vector2d PatchTracker::search(const GrayLevel& level, double scale,
                                     std::span<const Eigen::Vector2d> candidates, double& best) {
  Eigen::Vector2d found = Eigen::Vector2d::Zero();
  best = 0;
  for (const Eigen::Vector2d& candidate : candidates) {
    // Whole pixels are near enough to start from, and need no interpolation.
    const Eigen::Vector2d p = (candidate * scale + Eigen::Vector2d::Constant(0.5)).array().floor();
    if (!inside(level, p)) continue;
    std::int32_t sums[3];
    kernels_->searchSums(shape_, level.row(static_cast<int>(p.y()) - half_) + static_cast<int>(p.x()) - half_,
                         level.stride(), template_.value.data(), sums);
    const double mean = sums[0], square = sums[1];
    const double energy = square - mean * mean / search_weight_sum_;
    if (sums[2] <= 0 || energy < kMinEnergy * search_weight_sum_) continue;
    const double correlation = static_cast<double>(sums[2]) * sums[2] / energy;
    if (correlation > best) {
      best = correlation;
      found = p;
    }
  }
  return found;
}

bool PatchTracker::refine(const GrayLevel& level, Eigen::Vector2d& at, int iterations,
                          double tolerance) const {
  const Template& t = template_;
  const Eigen::Vector2d start = at;
  for (int k = 0; k < iterations; ++k) {
    const Place place = placeOf(level, at);
    std::int32_t sums[3];
    kernels_->projectPatch(shape_, place.origin, place.stride, place.fx, place.fy, t.value.data(),
                           t.sx.data(), t.sy.data(), sums);
    const double common = sums[0], gain = common / t.value_energy;
    if (gain < kMinGain) return false;
    const Eigen::Vector2d b((sums[1] - t.along_x * common) / (kGradientStep * t.scale_x),
                            (sums[2] - t.along_y * common) / (kGradientStep * t.scale_y));
    Eigen::Vector2d step = t.inverse_hessian * b / -gain;
    const double length = step.norm();
    if (length > kMaxStep) step *= kMaxStep / length;
    at = place.position + step;
    if (!inside(level, at) || (at - start).norm() > kMostFromStart) return false;
    if (length < tolerance) break;
  }
  return true;
}

PatchMatch PatchTracker::track(const GrayPyramid& source, const Eigen::Vector2d& at,
                               const GrayPyramid& target, std::span<const Eigen::Vector2d> candidates,
                               int finest) {
  PatchMatch match;
  const int top = source.levels() - 1;
  double scale = 1.0 / (1 << top);
  if (candidates.empty() || !makeTemplate(source.level(top), at * scale)) return match;
  double best = 0;
  Eigen::Vector2d position = search(target.level(top), scale, candidates, best);
  if (best <= 0) return match;
  for (int l = top; l >= finest; --l) {
    if (l < top) {
      position *= 2.0;
      scale *= 2.0;
      if (!makeTemplate(source.level(l), at * scale)) return match;
    }
    const bool fine = l == finest;
    if (!refine(target.level(l), position, fine ? kFineIterations : kCoarseIterations,
                fine ? kFineTolerance : kCoarseTolerance))
      return match;
  }
  finish(target.level(finest), position, match);
  match.position /= scale;
  match.covariance /= scale * scale;
  return match;
}

void PatchTracker::finish(const GrayLevel& target, const Eigen::Vector2d& position, PatchMatch& match) const {
  const double c = correlation(target, position);
  if (!(c > 0)) return;
  match.position = position;
  match.correlation = c;
  const double noise = template_.energy * std::max(1.0 - c * c, 0.0) / (c * c);
  match.covariance = noise * template_.inverse_hessian * template_.spread * template_.inverse_hessian;
  match.found = true;
}

PatchMatch PatchTracker::polish(const GrayLevel& source, const Eigen::Vector2d& at, const GrayLevel& target,
                                const Eigen::Vector2d& start) {
  PatchMatch match;
  Eigen::Vector2d position = start;
  if (makeTemplate(source, at) && refine(target, position, kFineIterations, kFineTolerance))
    finish(target, position, match);
  return match;
}

}  // namespace fathom::stereo

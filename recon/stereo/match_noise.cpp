#include "recon/stereo/match_noise.hpp"

#include <algorithm>
#include <cmath>

#include "recon/geometry/order_statistics.hpp"
#include "recon/stereo/midpoint_triangulation.hpp"

namespace fathom::stereo {

MatchNoise::MatchNoise(std::size_t max_matches) {
  matches_.reserve(max_matches);
  ratios_.reserve(max_matches);
}

void MatchNoise::clear() {
  matches_.clear();
}

void MatchNoise::add(const EpipolarDistance::Offset& offset, const Eigen::Matrix2d& covariance) {
  const double variance = offset.normal.dot(covariance * offset.normal) + kPixelFloor * kPixelFloor;
  matches_.push_back({offset.distance, std::sqrt(variance)});
}

double MatchNoise::scale() {
  if (matches_.size() < kMinMatches) return kUsual;
  ratios_.clear();
  for (std::size_t i = 1; i < matches_.size(); ++i) {
    const Match &a = matches_[i - 1], &b = matches_[i];
    ratios_.push_back(std::abs(a.distance - b.distance) / std::hypot(a.sigma, b.sigma));
  }
  return std::max(kLeast, kMadToSigma * median(std::span(ratios_)));
}

void MatchNoise::widen(StereoResult& result) {
  result.noise_scale = static_cast<float>(scale());
  for (StereoPoint& p : result.points) {
    p.sigma_z *= result.noise_scale;
    for (float& c : p.covariance) c *= result.noise_scale * result.noise_scale;
  }
}

}  // namespace fathom::stereo

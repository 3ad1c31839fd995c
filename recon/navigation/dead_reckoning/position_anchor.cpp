#include "recon/navigation/dead_reckoning/position_anchor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"

namespace fathom::nav {
namespace {

constexpr double kMinSigma = 0.1;     // [m] least standard deviation of a fix
constexpr double kMaxSigma = 1000.0;  // [m] a fix worse than this is no fix
constexpr double kGate = 3.0;         // standard deviations
constexpr double kStale = 3.0;        // standard deviations of a fix, in drift beyond the least of its kind

}  // namespace

void PositionAnchor::Series::add(const Difference& difference) noexcept {
  if (seen++ % stride != 0) return;
  if (size == kCapacity) {
    for (int i = 0; i < kCapacity / 2; ++i)
      items[static_cast<std::size_t>(i)] = items[static_cast<std::size_t>(2 * i)];
    size = kCapacity / 2;
    stride *= 2;
    if ((seen - 1) % stride != 0) return;
  }
  items[static_cast<std::size_t>(size++)] = difference;
}

void PositionAnchor::add(FixKind kind, const Eigen::Vector2d& difference, double sigma,
                         double unlocked_s) noexcept {
  ++(kind == FixKind::kGps ? counters_.gps : counters_.usbl);
  if (!difference.allFinite() || !(sigma >= 0 && sigma < kMaxSigma) || !std::isfinite(unlocked_s)) {
    ++counters_.refused;
    return;
  }
  (kind == FixKind::kGps ? gps_ : usbl_).add({difference, std::max(sigma, kMinSigma), unlocked_s});
}

std::optional<PositionAnchor::Mean> PositionAnchor::meanOf(const Series& series, double unlocked_s,
                                                           double unknown_velocity) noexcept {
  const std::span all(series.items.data(), static_cast<std::size_t>(series.size));
  const auto drift = [&](const Difference& d) {
    return unknown_velocity * std::abs(unlocked_s - d.unlocked_s);
  };
  double least = std::numeric_limits<double>::infinity();
  for (const Difference& d : all) least = std::min(least, drift(d));
  std::array<Difference, kCapacity> now;
  std::size_t size = 0;
  for (const Difference& d : all)
    if (drift(d) <= least + kStale * d.sigma)
      now[size++] = {d.north_east, hypotenuse(d.sigma, drift(d)), d.unlocked_s};
  return meanOf(std::span(now.data(), size));
}

std::optional<PositionAnchor::Mean> PositionAnchor::meanOf(std::span<const Difference> items) noexcept {
  if (items.empty()) return std::nullopt;
  Eigen::Vector2d centre, spread;
  std::array<double, kCapacity> all;
  const std::span values(all.data(), items.size());
  for (int axis = 0; axis < 2; ++axis) {
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = items[i].north_east(axis);
    centre(axis) = median(values);
    spread(axis) = madSigma(values, centre(axis));
  }
  Mean mean;
  mean.best_sigma = std::numeric_limits<double>::infinity();
  for (const Difference& d : items) {
    const Eigen::Array2d gate = kGate * spread.array().max(d.sigma);
    if (((d.north_east - centre).array().abs() > gate).any()) {
      ++mean.outliers;
      continue;
    }
    const double weight = 1.0 / (d.sigma * d.sigma);
    mean.north_east += weight * d.north_east;
    mean.weight += weight;
    mean.best_sigma = std::min(mean.best_sigma, d.sigma);
    ++mean.used;
  }
  // The median may be in no difference's gate when the two axes' medians come from different fixes.
  if (mean.used == 0)
    return Mean{centre, 1.0 / spread.squaredNorm(), spread.norm(), static_cast<int>(items.size()), 0};
  mean.north_east /= mean.weight;
  // Two fixes that disagree are both inside the gate of their own spread: then both sigmas are inflated
  // (Birge's ratio: the mean's variance grows by chi-square over its degrees of freedom).
  double chi2 = 0;
  for (const Difference& d : items) {
    const Eigen::Array2d gate = kGate * spread.array().max(d.sigma);
    if (((d.north_east - centre).array().abs() <= gate).all())
      chi2 += (d.north_east - mean.north_east).squaredNorm() / (d.sigma * d.sigma);
  }
  if (mean.used > 1) mean.weight /= std::max(1.0, chi2 / (2.0 * (mean.used - 1)));
  return mean;
}

std::optional<PositionAnchor::Estimate> PositionAnchor::estimate(FixKind kind, double unlocked_s,
                                                                 double unknown_velocity) const noexcept {
  const bool by_gps = kind == FixKind::kGps;
  const auto mean = meanOf(by_gps ? gps_ : usbl_, unlocked_s, unknown_velocity);
  if (!mean) return std::nullopt;
  return Estimate{mean->north_east, by_gps ? mean->best_sigma : 1 / std::sqrt(mean->weight),
                  by_gps ? mean->used : 0, by_gps ? 0 : mean->used, mean->outliers};
}

std::optional<PositionAnchor::Estimate> PositionAnchor::estimate(double unlocked_s,
                                                                 double unknown_velocity) const noexcept {
  const auto gps = estimate(FixKind::kGps, unlocked_s, unknown_velocity);
  auto usbl = estimate(FixKind::kUsbl, unlocked_s, unknown_velocity);
  if (usbl) usbl->sigma = hypotenuse(usbl->sigma, usbl_shared_);
  if (!gps || !usbl) return gps ? gps : usbl;
  const double of_gps = 1 / (gps->sigma * gps->sigma), of_usbl = 1 / (usbl->sigma * usbl->sigma);
  // Birge's ratio between the two kinds.
  const double apart2 = (gps->shift - usbl->shift).squaredNorm() / (1 / of_gps + 1 / of_usbl);
  return Estimate{(of_gps * gps->shift + of_usbl * usbl->shift) / (of_gps + of_usbl),
                  std::sqrt(std::max(1.0, apart2 / 2) / (of_gps + of_usbl)), gps->gps_used, usbl->usbl_used,
                  gps->outliers + usbl->outliers};
}

}  // namespace fathom::nav

#include "recon/navigation/gating/robust_factors.hpp"

#include <algorithm>
#include <cmath>

#include "recon/navigation/graph/shared_turns.hpp"

namespace fathom::slam {
namespace {

constexpr double kOffAt = 2;         // times what chance explains: a factor is switched off
constexpr double kNewWeight = 0.15;  // relative change of a weight that is worth the solver's work

}  // namespace

RobustFactors::RobustFactors(KeyframeStore& keyframes) : keyframes_(keyframes) {
  const NavigationConfig& config = keyframes.config();
  factors_.reserve(at(config.max_links + config.max_fixes));
  place_of_.resize(at(config.solver.max_measurements), -1);
}

bool RobustFactors::isShort(std::size_t spare) const {
  return factors_.size() + std::min(spare, factors_.capacity() / 8) >= factors_.capacity();
}

void RobustFactors::add(const RobustFactor& factor) {
  place_of_[at(factor.measurement)] = static_cast<int>(factors_.size());
  factors_.push_back(factor);
}

void RobustFactors::replaceMeasurement(RobustFactor& factor, int measurement) {
  std::swap(place_of_[at(measurement)], place_of_[at(factor.measurement)]);
  factor.measurement = measurement;
}

void RobustFactors::forget(int measurement) {
  const int place = place_of_[at(measurement)];
  if (place < 0) return;
  place_of_[at(measurement)] = -1;
  // Those before newest_ have been looked at once, those behind it have not.
  auto hole = at(place);
  if (hole < newest_) {
    move(--newest_, hole);
    hole = newest_;
  }
  move(factors_.size() - 1, hole);
  factors_.pop_back();
  if (next_ >= factors_.size()) next_ = 0;
}

void RobustFactors::move(std::size_t from, std::size_t to) {
  if (from == to) return;
  factors_[to] = factors_[from];
  place_of_[at(factors_[to].measurement)] = static_cast<int>(to);
}

void RobustFactors::reweight(bool settled, SharedTurns& turns) {
  if (factors_.empty()) return;
  int left = keyframes_.config().reweighted;
  for (; newest_ < factors_.size() && left > 0; ++newest_, --left)
    reweight(factors_[newest_], settled, turns);
  for (; left > 0; --left) {
    reweight(factors_[next_], settled, turns);
    next_ = (next_ + 1) % factors_.size();
  }
}

void RobustFactors::reweight(RobustFactor& r, bool settled, SharedTurns& turns) {
  turns.straightenAgain(r);
  if (r.confirmed) return;
  IncrementalSolver& solver = keyframes_.solver();
  const RelativePose factor = r.factor();
  const SE3 from = r.from == kWorld ? SE3() : solver.pose(r.from);
  const Vector6d e = relativePoseError(factor, from, solver.pose(r.to));
  const double chi2 = e.dot(factor.information * e);
  const bool off = r.off ? !(passesGate(r, turns) && settled) : settled && !(chi2 <= kOffAt * r.free_chi2);
  NavigationCounters& counters = keyframes_.counters();
  std::uint64_t& offs = r.fix ? counters.fixes_off : counters.links_off;
  if (off && !r.off) ++offs;
  if (!off && r.off) --offs;
  const double wanted = off ? 0 : cauchyWeight(chi2, r.free_chi2);
  if (off != r.off || std::abs(wanted - r.weight) > kNewWeight * r.weight) {
    (void)solver.setWeight(r.measurement, wanted);
    r.weight = wanted;
  }
  r.off = off;
}

// A factor that is switched off, by what the rest says.
bool RobustFactors::passesGate(const RobustFactor& r, SharedTurns& turns) const {
  const IncrementalSolver& solver = keyframes_.solver();
  const NavigationConfig& config = keyframes_.config();
  if (r.fix) {
    const SE3 from = r.from == kWorld ? SE3() : solver.pose(r.from);
    const Vector6d e = relativePoseError(r.factor(), from, solver.pose(r.to));
    return e.dot(r.spread * e) <= r.free_chi2;
  }
  const Matrix6d known = turns.relativeCovariance(r.from, r.to);
  return keyframes_.distance2(r.factor(), config.known_scale * known + r.spread) <= config.gate;
}

bool RobustFactors::rebuildIndices() {
  std::fill(place_of_.begin(), place_of_.end(), -1);
  for (std::size_t i = 0; i < factors_.size(); ++i) {
    const RobustFactor& r = factors_[i];
    const bool good = (r.from == kWorld || keyframes_.isNode(r.from)) && keyframes_.isNode(r.to) &&
                      keyframes_.isMeasurement(r.measurement) && !has(r.measurement) &&
                      r.spread.allFinite() && r.straightened_by.allFinite() &&
                      r.factor().information.allFinite();
    if (!good) return false;
    place_of_[at(r.measurement)] = static_cast<int>(i);
  }
  return (next_ < factors_.size() || next_ == 0) && newest_ <= factors_.size();
}

}  // namespace fathom::slam

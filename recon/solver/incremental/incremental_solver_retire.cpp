// Retirement of poses by the incremental solver.
#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "recon/solver/incremental/incremental_solver.hpp"
#include "recon/solver/incremental/retirement.hpp"

namespace fathom::slam {
namespace {

constexpr int kMostMeasurements = 2 * kMostLinks;  // of a pose that can be retired
constexpr int kScan = 1024;                        // indices that one call of leastNeeded looks at
constexpr int kChainLinks = 2;                     // neighbours of a pose within a chain
// A neighbour more is worth as much as so long a gap in the map [m]: about a line of a survey.
constexpr double kLinkWorth_m = 10;

}  // namespace

// Whether the factors have a measurement with its present weight.
bool IncrementalSolver::isTakenIn(int k) const {
  const Measurement& m = measurements_[k];
  const Part part = active().part[at(k)];
  if (!errors_.has(k) || part == Part::kNone) return false;
  if (part != Part::kLeftOut && m.weight != (part == Part::kItself ? active().in_factor[at(k)].weight : 1))
    return false;
  if (!building_) return true;
  const bool in_next = m.born < measurements_at_build_;
  if (in_next && is_left_out_[at(k)] != 0) return true;
  return in_next ? m.weight == builder_.weightOf(k) : m.composed;
}

// Whether a pose's measurements are in the factors, so that what is composed of them is in them as well.
bool IncrementalSolver::isSettled(int pose) const {
  if (!active().factor.has(pose) || (building_ && born_[at(pose)] >= poses_at_build_)) return false;
  for (int k = measurements_.first(pose); k >= 0; k = measurements_.next(k, pose))
    if (!isTakenIn(k)) return false;
  return true;
}

bool IncrementalSolver::forget(int k) {
  if (k < 0 || k >= measurements_.size() || !measurements_[k].in_use || measurements_[k].weight != 0 ||
      !isTakenIn(k))
    return false;
  removeMeasurement(k);
  errors_.refresh();
  return true;
}

void IncrementalSolver::removeMeasurement(int k) {
  errors_.drop(k);
  measurements_.remove(k);
  stale_[at(k)] = 0;
  for (Factor& f : factors_) setPart(f, k, Part::kNone);
}

// Adds a measurement composed of some that the factors have; joins it
// with an earlier one between the same two poses.
void IncrementalSolver::addComposed(RelativePose composed) {
  int k = -1;
  if (take(composed, true, &k) != AddStatus::kOk) return;
  const auto partner = [&](int other) {
    const Measurement& m = measurements_[other];
    return other != k && m.composed && std::minmax(m.from, m.to) == std::minmax(composed.from, composed.to);
  };
  for (int other = measurements_.first(composed.to); other >= 0;
       other = measurements_.next(other, composed.to)) {
    if (!partner(other)) continue;
    const std::array<const Measurement*, 2> both{&measurements_[k], &measurements_[other]};
    const SE3 from = composed.from == kWorld ? SE3() : poses_[at(composed.from)];
    const StarLink link = starLink(both, composed.to, from.inverse() * poses_[at(composed.to)]);
    composed.T_from_to = link.T_neighbour_pose;
    composed.information = residualInformation(link.information);
    removeMeasurement(other);
    measurements_.remove(k);
    if (take(composed, true, &k) != AddStatus::kOk) return;
    break;
  }
  for (Factor& f : factors_) {
    if (&f != &active() && !(building_ && is_built_)) continue;
    setPart(f, k, Part::kByOthers);
    f.in_factor[at(k)].weight = 1;
  }
  stale_[at(k)] = 0;
  errors_.take(k);
}

RetireStatus IncrementalSolver::retire(int pose) {
  if (pose < 0 || pose >= poses_count_ || isRetired(pose)) return RetireStatus::kNoSuchPose;
  if (held_[at(pose)]) return RetireStatus::kHeld;
  if (!isSettled(pose)) return RetireStatus::kNotSettled;
  std::array<std::pair<int, int>, kMostMeasurements> star;  // neighbour, measurement
  std::size_t count = 0;
  for (int k = measurements_.first(pose); k >= 0; k = measurements_.next(k, pose)) {
    if (count == star.size()) return RetireStatus::kTooManyLinks;
    const Measurement& m = measurements_[k];
    star[count++] = {m.from == pose ? m.to : m.from, k};
  }
  std::sort(star.begin(), star.begin() + static_cast<std::ptrdiff_t>(count));
  std::array<StarLink, kMostLinks> links;
  std::size_t link_count = 0;
  for (std::size_t i = 0; i < count;) {
    const int neighbour = star[i].first;
    std::array<const Measurement*, kMostMeasurements> group;
    std::size_t in_group = 0;
    for (; i < count && star[i].first == neighbour; ++i)
      if (measurements_[star[i].second].weight > 0) group[in_group++] = &measurements_[star[i].second];
    if (in_group == 0) continue;
    if (link_count == links.size()) return RetireStatus::kTooManyLinks;
    const SE3 from = neighbour == kWorld ? SE3() : poses_[at(neighbour)];
    links[link_count] = starLink({group.data(), in_group}, pose, from.inverse() * poses_[at(pose)]);
    links[link_count++].neighbour = neighbour;
  }
  std::array<RelativePose, kMostLinks> left;
  const int left_count = retireStar({links.data(), link_count}, left);

  for (std::size_t i = 0; i < count; ++i) removeMeasurement(star[i].second);
  for (int i = 0; i < left_count; ++i) addComposed(left[at(i)]);
  errors_.refresh();
  // The next factor buries it when it is settled, or now if it has been.
  for (Factor& f : factors_)
    if ((&f == &active() || (building_ && is_built_)) && f.factor.has(pose))
      f.factor.bury(f.factor.positionOf(pose));
  born_[at(pose)] = -1;
  free_[at(free_count_++)] = pose;
  ++retired_;
  restartSearch();
  return RetireStatus::kOk;
}

int IncrementalSolver::leastNeeded(int keep, std::span<const std::uint8_t> must_stay) {
  int best = -1;
  double least = std::numeric_limits<double>::infinity();
  for (int seen = 0; seen < std::min(kScan, poses_count_); ++seen) {
    scanned_ = (scanned_ + 1) % poses_count_;
    const int pose = scanned_;
    if (isRetired(pose) || held_[at(pose)] || born_[at(pose)] >= births_ - keep) continue;
    if (at(pose) < must_stay.size() && must_stay[at(pose)] != 0) continue;
    std::array<int, kMostLinks> neighbours;
    int links = 0, measured = 0;
    double nearest[kChainLinks] = {};
    bool fits = true;
    for (int k = measurements_.first(pose); k >= 0 && fits; k = measurements_.next(k, pose)) {
      const Measurement& m = measurements_[k];
      const int other = m.from == pose ? m.to : m.from;
      fits = ++measured <= kMostMeasurements;
      if (other == kWorld || m.weight == 0 ||
          std::find(neighbours.begin(), neighbours.begin() + links, other) != neighbours.begin() + links)
        continue;
      fits = fits && links + 1 < kMostLinks;
      if (!fits) break;
      neighbours[at(links)] = other;
      const double apart = (poses_[at(pose)].translation() - poses_[at(other)].translation()).norm();
      if (links < kChainLinks) {
        nearest[links] = apart;
      } else if (double& farther = nearest[0] > nearest[1] ? nearest[0] : nearest[1]; apart < farther) {
        farther = apart;
      }
      ++links;
    }
    const double worth = kLinkWorth_m * std::max(0, links - kChainLinks) + nearest[0] + nearest[1];
    if (!fits || worth >= least || !isSettled(pose)) continue;
    least = worth;
    best = pose;
  }
  return best;
}

}  // namespace fathom::slam

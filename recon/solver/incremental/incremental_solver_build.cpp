// The incremental solver's next factor.
#include <algorithm>
#include <cstdlib>
#include <limits>

#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {
namespace {

// Of a factor's store, so much is left to measurements to come.
constexpr int kGrowthPart = 8;
// Where there is no room for all measurements, those between poses more than so many births apart are halved,
// again and again, then left out; and in the end all but those that join each pose to an earlier one.
constexpr int kFarApart = 64, kWithoutFar = 7, kOnlyJoining = 8;
constexpr std::int64_t kThinFor = 256;  // births of poses, before more room is hoped for
constexpr double kFullRank = 1e-10;     // least share of the greatest information where all six are measured

}  // namespace

int IncrementalSolver::laterEnd(int k) const {
  const Measurement& m = measurements_[k];
  return m.from == kWorld || born_[at(m.to)] > born_[at(m.from)] ? m.to : m.from;
}

bool IncrementalSolver::hasFullRank(int k) const {
  const Vector6d rows = measurements_[k].root.rowwise().squaredNorm();
  return rows.minCoeff() > kFullRank * rows.maxCoeff();
}

// Whether a measurement is the one that joins its later pose to the
// earlier ones: one of full rank, the nearest in time.
bool IncrementalSolver::joins(int k) const {
  const int pose = laterEnd(k);
  int best = -1;
  bool best_is_full = false;
  std::int64_t best_gap = 0;
  for (int j = measurements_.first(pose); j >= 0; j = measurements_.next(j, pose)) {
    const Measurement& m = measurements_[j];
    if (m.weight == 0 || laterEnd(j) != pose) continue;
    const int other = m.from == pose ? m.to : m.from;
    const std::int64_t gap =
        other == kWorld ? std::numeric_limits<std::int64_t>::max() : born_[at(pose)] - born_[at(other)];
    const bool is_full = hasFullRank(j);
    if (best >= 0 && (is_full != best_is_full ? best_is_full : best_gap <= gap)) continue;
    best = j;
    best_is_full = is_full;
    best_gap = gap;
  }
  return best == k;
}

void IncrementalSolver::setPart(Factor& f, int k, Part part) {
  f.left_out += (part == Part::kLeftOut ? 1 : 0) - (f.part[at(k)] == Part::kLeftOut ? 1 : 0);
  f.part[at(k)] = part;
}

// Chooses the measurements that the next factor leaves out, by thinning_.
void IncrementalSolver::chooseLeftOut() {
  constexpr std::uint64_t kGolden = 0x9E3779B97F4A7C15;  // spreads successive numbers evenly (Knuth)
  for (int k = 0; k < measurements_.size(); ++k) {
    const Measurement& m = measurements_[k];
    is_left_out_[at(k)] = 0;
    if (thinning_ == 0 || !m.in_use) continue;
    const bool far = m.from != kWorld && std::abs(born_[at(m.to)] - born_[at(m.from)]) > kFarApart;
    const bool taken =
        thinning_ < kWithoutFar && (static_cast<std::uint64_t>(m.born) * kGolden) >> (64 - thinning_) == 0;
    is_left_out_[at(k)] = (thinning_ == kOnlyJoining || (far && !taken)) && !joins(k) ? 1 : 0;
  }
}

void IncrementalSolver::beginBuild() {
  Factor& next = factors_[at(1 - active_)];
  const int kept = closes_late_ > 0.5 ? config_.kept_last : config_.kept_last / 4;
  for (int i = 0; i < poses_count_; ++i)
    is_newest_[at(i)] = births_ > kept && born_[at(i)] >= births_ - kept ? 1 : 0;
  is_built_ = false;
  next.poses_to_come.clear();
  next.to_come.clear();
  poses_at_build_ = births_;
  measurements_at_build_ = measurements_.births();
  if (thinning_ > 0 && births_ >= thin_until_) --thinning_;
  for (build_work_ = 0;; ++thinning_) {
    chooseLeftOut();
    build_work_ += builder_.begin(poses_.subspan(0, at(poses_count_)), held_.subspan(0, at(poses_count_)),
                                  is_newest_.subspan(0, at(poses_count_)), is_left_out_, measurements_,
                                  damping_, next.factor);
    const std::int64_t store = config_.max_factor_blocks;
    building_ = builder_.blocks() <= (thinning_ == kOnlyJoining ? store : store - store / kGrowthPart);
    if (building_ || thinning_ == kOnlyJoining) break;
    thin_until_ = births_ + kThinFor;
  }
  next.damping = damping_;
  next.moves = moves_;
}

// Marks what a finished factor contains: since it was begun, poses and measurements may have been removed and
// others have taken their places.
void IncrementalSolver::settle(Factor& f) {
  for (int j = 0; j < f.factor.size(); ++j) {
    const std::int64_t born = born_[at(f.factor.poseAt(j))];
    if (born < 0 || born >= poses_at_build_) f.factor.bury(j);
  }
  for (int k = 0; k < measurements_.size(); ++k) {
    const Measurement& m = measurements_[k];
    setPart(f, k, Part::kNone);
    if (!m.in_use) continue;
    if (m.born < measurements_at_build_) {
      setPart(f, k, is_left_out_[at(k)] != 0 ? Part::kLeftOut : Part::kItself);
    } else if (m.composed) {
      setPart(f, k, Part::kByOthers);
      f.in_factor[at(k)].weight = 1;
    }
  }
  is_built_ = true;
}

// Works on the next factor, and takes it up when it has all poses and measurements.
void IncrementalSolver::build(StepReport& report) {
  Factor& next = factors_[at(1 - active_)];
  const std::int64_t quota = urgent_ ? config_.urgent_quota : config_.build_quota;
  std::int64_t work = 0;
  if (!building_) {
    if (!urgent_ && births_ < poses_at_build_ + config_.rebuild_after) return;
    if (births_ < no_build_until_) {
      urgent_ = false;
      return;
    }
    beginBuild();
    work = build_work_;
    build_work_ = 0;
    report.build_work += work;
    if (!building_) {  // no room even for what joins poses: the present factor stays
      no_build_until_ = births_ + kThinFor;
      urgent_ = false;
      return;
    }
  }
  const std::int64_t begun = work;
  work += builder_.run(quota - work, next.factor, next.in_factor);
  if (!builder_.running()) {
    if (!is_built_) settle(next);
    if (work < quota) work += extend(next, quota - work);
  }
  report.build_work += work - begun;
  build_work_ += work;
  const bool complete = next.poses_to_come.empty() && next.to_come.empty();
  if (builder_.running() || (!complete && work >= quota)) return;
  work_of_build_ = build_work_;
  active_ = 1 - active_;
  building_ = urgent_ = false;
  restart_ = true;
  ++report.factors_replaced;
  for (int k = 0; k < measurements_.size(); ++k) {
    const Part part = active().part[at(k)];
    stale_[at(k)] = part == Part::kItself ? staleness(k) : 0;
    urgent_ = urgent_ || (part == Part::kByOthers && measurements_[k].weight != 1);
  }
}

}  // namespace fathom::slam

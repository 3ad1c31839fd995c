#include <algorithm>
#include <cstdlib>
#include <limits>

#include "recon/geometry/state_values.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"

// The incremental solver's next factor; its saved state: poses and measurements. Factors and errors follow
// from them: load() builds a factor of all measurements, linearised at the poses, so that a loaded solver has
// the same poses and at least as good a factor as the one that was saved.

namespace fathom::slam {
namespace {

// Of a factor's store, so much is left to measurements to come.
constexpr int kGrowthPart = 8;
// Where there is no room for all measurements, those between poses more than so many births apart are halved,
// again and again, then left out; and in the end all but those that join each pose to an earlier one.
constexpr int kFarApart = 64, kWithoutFar = 7, kOnlyJoining = 8;
constexpr std::int64_t kThinFor = 256;  // births of poses, before more room is hoped for
constexpr double kFullRank = 1e-10;     // least share of the greatest information where all six are measured

constexpr std::int64_t kUnlimited = std::numeric_limits<std::int64_t>::max();

}  // namespace

int IncrementalSolver::laterEnd(int k) const {
  const Measurement& m = measurements_[k];
  return m.from == kWorld || created_[at(m.to)] > created_[at(m.from)] ? m.to : m.from;
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
        other == kWorld ? std::numeric_limits<std::int64_t>::max() : created_[at(pose)] - created_[at(other)];
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
    const bool far = m.from != kWorld && std::abs(created_[at(m.to)] - created_[at(m.from)]) > kFarApart;
    const bool taken =
        thinning_ < kWithoutFar && (static_cast<std::uint64_t>(m.born) * kGolden) >> (64 - thinning_) == 0;
    is_left_out_[at(k)] = (thinning_ == kOnlyJoining || (far && !taken)) && !joins(k) ? 1 : 0;
  }
}

void IncrementalSolver::beginBuild() {
  Factor& next = factors_[at(1 - active_)];
  const int kept = short_closures_ > 0.5 ? config_.kept_last : config_.kept_last / 4;
  for (int i = 0; i < poses_count_; ++i)
    is_newest_[at(i)] = poses_ever_ > kept && created_[at(i)] >= poses_ever_ - kept ? 1 : 0;
  is_built_ = false;
  next.poses_to_come.clear();
  next.to_come.clear();
  poses_at_build_ = poses_ever_;
  measurements_at_build_ = measurements_.births();
  if (thinning_ > 0 && poses_ever_ >= thin_until_) --thinning_;
  for (build_work_ = 0;; ++thinning_) {
    chooseLeftOut();
    build_work_ += builder_.begin(poses_.subspan(0, at(poses_count_)), fixed_.subspan(0, at(poses_count_)),
                                  is_newest_.subspan(0, at(poses_count_)), is_left_out_, measurements_,
                                  damping_, next.factor);
    const std::int64_t store = config_.max_factor_blocks;
    building_ = builder_.blocks() <= (thinning_ == kOnlyJoining ? store : store - store / kGrowthPart);
    if (building_ || thinning_ == kOnlyJoining) break;
    thin_until_ = poses_ever_ + kThinFor;
  }
  next.damping = damping_;
  next.moves = moves_;
}

// Marks what a finished factor contains: since it was begun, poses and measurements may have been removed and
// others have taken their places.
void IncrementalSolver::settle(Factor& f) {
  for (int j = 0; j < f.factor.size(); ++j) {
    const std::int64_t born = created_[at(f.factor.poseAt(j))];
    if (born < 0 || born >= poses_at_build_) f.factor.removePose(j);
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
    if (!urgent_ && poses_ever_ < poses_at_build_ + config_.rebuild_after) return;
    if (poses_ever_ < no_build_until_) {
      urgent_ = false;
      return;
    }
    beginBuild();
    work = build_work_;
    build_work_ = 0;
    report.build_work += work;
    if (!building_) {  // no room even for what joins poses: the present factor stays
      no_build_until_ = poses_ever_ + kThinFor;
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

template <typename Archive, typename Self>
void IncrementalSolver::exchange(Archive& archive, Self& self) {
  archive(self.poses_count_, self.free_count_, self.poses_ever_, self.retired_, self.scanned_,
          self.short_closures_, self.work_of_update_);
  archive.require(self.poses_count_ >= 0 && self.poses_count_ <= self.config_.max_poses &&
                      self.free_count_ >= 0 && self.free_count_ <= self.poses_count_ && self.scanned_ >= 0 &&
                      self.scanned_ <= self.poses_count_ && self.work_of_update_ > 0,
                  "more poses than there is room for");
  if constexpr (Archive::kLoading)
    if (!archive.ok()) return;
  archive.elements(self.free_.data(), at(self.free_count_));
  archive.elements(self.poses_.data(), at(self.poses_count_));
  archive.elements(self.fixed_.data(), at(self.poses_count_));
  archive.elements(self.created_.data(), at(self.poses_count_));
}

void IncrementalSolver::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
  measurements_.save(writer);
}

bool IncrementalSolver::load(rt::StateReader& reader) {
  exchange(reader, *this);
  if (!reader.ok() || !measurements_.load(reader, poses_count_)) return false;
  if (!posesAreValid()) {
    reader.fail("poses that cannot be");
    return false;
  }
  rebuildFactor();
  return true;
}

bool IncrementalSolver::posesAreValid() const {
  int retired = 0;
  for (int i = 0; i < poses_count_; ++i) {
    retired += isRetired(i) ? 1 : 0;
    if (!isFinite(pose(i)) || fixed_[at(i)] > 1 || created_[at(i)] >= poses_ever_) return false;
    if (isRetired(i) && measurements_.first(i) >= 0) return false;
  }
  return retired == free_count_ &&
         areFreePlaces(free_.first(at(free_count_)), poses_count_, [&](int i) { return isRetired(i); });
}

void IncrementalSolver::rebuildFactor() {
  fresh_count_ = moved_count_ = changed_count_ = rises_ = 0;
  std::fill(is_changed_.begin(), is_changed_.end(), std::uint8_t{0});
  std::fill(stale_.begin(), stale_.end(), 0.0);
  for (std::span<double>* s : {&gradient_before_, &solved_, &direction_})
    std::fill(s->begin(), s->end(), 0.0);
  errors_.clear();
  for (int k = 0; k < measurements_.size(); ++k)
    if (measurements_[k].in_use) errors_.take(k);
  errors_.refresh();

  for (Factor& f : factors_) {
    f.factor.clear();
    f.poses_to_come.clear();
    f.to_come.clear();
    std::fill(f.part.begin(), f.part.end(), Part::kNone);
    std::fill(f.in_factor.begin(), f.in_factor.end(), InFactor{});
    f.left_out = 0;
  }
  damping_ = 0;
  next_start_ = moves_ = thin_until_ = no_build_until_ = 0;
  thinning_ = 0;
  active_ = 0;
  beginBuild();
  active_ = 1;
  if (building_) build_work_ += builder_.run(kUnlimited, active().factor, active().in_factor);
  if (building_)
    settle(active());
  else
    active().factor.clear();  // no room even for what joins poses
  work_of_build_ = build_work_;
  build_work_ = 0;
  building_ = urgent_ = at_minimum_ = false;
  restart_ = true;
}

}  // namespace fathom::slam

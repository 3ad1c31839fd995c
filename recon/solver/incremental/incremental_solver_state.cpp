// The incremental solver as saved state: poses and measurements. Factors and errors follow from them: load()
// builds a factor of all measurements, linearised at the poses, so that a loaded solver has the same poses
// and at least as good a factor as the one that was saved.
#include <algorithm>
#include <limits>

#include "recon/geometry/state_values.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {
namespace {

constexpr std::int64_t kUnlimited = std::numeric_limits<std::int64_t>::max();

}  // namespace

template <typename Archive, typename Self>
void IncrementalSolver::exchange(Archive& archive, Self& self) {
  archive(self.poses_count_, self.free_count_, self.births_, self.retired_, self.scanned_, self.closes_late_,
          self.work_of_update_);
  archive.require(self.poses_count_ >= 0 && self.poses_count_ <= self.config_.max_poses &&
                      self.free_count_ >= 0 && self.free_count_ <= self.poses_count_ && self.scanned_ >= 0 &&
                      self.scanned_ <= self.poses_count_ && self.work_of_update_ > 0,
                  "more poses than there is room for");
  if constexpr (Archive::kLoading)
    if (!archive.ok()) return;
  archive.elements(self.free_.data(), at(self.free_count_));
  archive.elements(self.poses_.data(), at(self.poses_count_));
  archive.elements(self.held_.data(), at(self.poses_count_));
  archive.elements(self.born_.data(), at(self.poses_count_));
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
    if (!isFinite(pose(i)) || held_[at(i)] > 1 || born_[at(i)] >= births_) return false;
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

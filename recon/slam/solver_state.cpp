// The incremental solver as saved state: poses and measurements. Factors and errors follow from them: load()
// builds a factor of all that is there, linearised where the poses are, so that a solver that was loaded has
// the same poses and at least as good a factor as the one that was saved.
#include <algorithm>
#include <limits>
#include <vector>

#include "recon/geometry/state_values.hpp"
#include "recon/slam/incremental_solver.hpp"
#include "recon/slam/matrix_state.hpp"

namespace fathom::slam {
namespace {

constexpr std::int64_t kNoQuota = std::numeric_limits<std::int64_t>::max();

// Each index below `size` once, and `free` of it.
bool areFree(std::span<const int> indices, int size, const auto& free) {
  std::vector<bool> met(static_cast<std::size_t>(size));
  for (const int i : indices) {
    if (i < 0 || i >= size || met[static_cast<std::size_t>(i)] || !free(i)) return false;
    met[static_cast<std::size_t>(i)] = true;
  }
  return true;
}

bool finite(const SE3& T) {
  return T.translation().allFinite() && T.rotation().coeffs().allFinite();
}

template <typename Archive, typename Self>
void exchangeMeasurement(Archive& archive, Self& m) {
  archive(m.in_use);
  if (!m.in_use) return;
  archive(m.from, m.to, m.T_from_to, m.weight, m.lever, m.composed, m.born);
  exchangeSparse(archive, m.root);
}

}  // namespace

template <typename Archive, typename Self>
void Measurements::exchange(Archive& archive, Self& self) {
  archive(self.size_, self.free_count_, self.births_);
  archive.require(self.size_ >= 0 && static_cast<std::size_t>(self.size_) <= self.all_.size() &&
                      self.free_count_ >= 0 && self.free_count_ <= self.size_,
                  "more measurements than there is room for");
  if constexpr (Archive::kLoading)
    if (!archive.ok()) return;
  archive.elements(self.free_.data(), static_cast<std::size_t>(self.free_count_));
  for (auto& m : self.all_.first(static_cast<std::size_t>(self.size_))) exchangeMeasurement(archive, m);
}

void Measurements::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool Measurements::load(rt::StateReader& reader, int poses) {
  exchange(reader, *this);
  if (!reader.ok()) return false;
  std::vector<int> in_use;
  for (int k = 0; k < size_; ++k) {
    const Measurement& m = (*this)[k];
    if (!m.in_use) continue;
    const bool good = m.from >= kWorld && m.from < poses && m.to >= 0 && m.to < poses && m.from != m.to &&
                      finite(m.T_from_to) && m.root.allFinite() && m.weight >= 0 && std::isfinite(m.weight) &&
                      m.lever > 0 && std::isfinite(m.lever) && m.born >= 0 && m.born < births_;
    if (!good) {
      reader.fail("a measurement that cannot be");
      return false;
    }
    in_use.push_back(k);
  }
  const std::span<const int> free(free_.data(), static_cast<std::size_t>(free_count_));
  if (in_use.size() + free.size() != static_cast<std::size_t>(size_) ||
      !areFree(free, size_, [&](int k) { return !(*this)[k].in_use; })) {
    reader.fail("measurements' places contradict each other");
    return false;
  }
  // A pose's measurements lie newest first.
  std::sort(in_use.begin(), in_use.end(), [&](int a, int b) {
    return std::make_pair((*this)[a].born, a) < std::make_pair((*this)[b].born, b);
  });
  std::fill(first_.begin(), first_.end(), -1);
  for (const int k : in_use) {
    Measurement& m = all_[static_cast<std::size_t>(k)];
    const auto chain = [&](int pose, int end) {
      m.next[end] = first_[static_cast<std::size_t>(pose)];
      first_[static_cast<std::size_t>(pose)] = k;
    };
    if (m.from != kWorld) chain(m.from, 0);
    chain(m.to, 1);
  }
  return true;
}

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
  if (!posesAreWhole()) {
    reader.fail("poses that cannot be");
    return false;
  }
  buildAnew();
  return true;
}

bool IncrementalSolver::posesAreWhole() const {
  int retired = 0;
  for (int i = 0; i < poses_count_; ++i) {
    retired += isRetired(i) ? 1 : 0;
    if (!finite(pose(i)) || held_[at(i)] > 1 || born_[at(i)] >= births_) return false;
    if (isRetired(i) && measurements_.first(i) >= 0) return false;
  }
  return retired == free_count_ &&
         areFree(free_.first(at(free_count_)), poses_count_, [&](int i) { return isRetired(i); });
}

void IncrementalSolver::buildAnew() {
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
  if (building_) build_work_ += builder_.run(kNoQuota, active().factor, active().in_factor);
  if (building_)
    settle(active());
  else
    active().factor.clear();  // no room even for what joins poses
  work_of_build_ = build_work_;
  build_work_ = 0;
  building_ = urgent_ = no_way_down_ = false;
  restart_ = true;
}

}  // namespace fathom::slam

// Keyframes and references that make room for those to come.
#include <algorithm>
#include <cstdlib>

#include "recon/slam/navigation_graph.hpp"
#include "recon/slam/retirement.hpp"

namespace fathom::slam {
namespace {

// So much is kept free of each pool, an eighth of it at most: a pose whose measurements have not settled must
// wait, and then a later keyframe makes the room.
constexpr std::size_t kSpare = 32;
// Poses that fixes and links still come for, and those whose sensors are still being judged.
constexpr int kNewestKept = HeadingTrust::kWindow, kLeastKept = 4;
constexpr int kLookedAt = 64;  // references
constexpr std::size_t kMostNamed = 2 * kMostLinks;

bool isShort(std::size_t used, std::size_t all) {
  return used + std::min(kSpare, all / 8) >= all;
}

}  // namespace

void NavigationGraph::makeRoom() {
  retired_.clear();
  const auto isFull = [&] {
    return isShort(frames_.size(), frames_.capacity()) || isShort(robust_.size(), robust_.capacity()) ||
           isShort(at(solver_.measurementsInUse()), robust_of_.size());
  };
  while (retired_.size() < kRetiredAtOnce && isFull())
    if (!retireKeyframe()) break;
  if (isShort(references_.size(), references_.capacity())) retireReference();
}

bool NavigationGraph::retireKeyframe() {
  const int kept = std::clamp(config_.max_keyframes / 4, kLeastKept, kNewestKept);
  const int node = solver_.leastNeeded(kept, must_stay_);
  if (node < 0) return false;
  const int k = frame_of_node_[at(node)];
  const SE3 pose = solver_.pose(node);
  if (!retireNode(node)) return false;
  const Frame gone = frames_[at(k)];
  if (gone.waiting) changed_.erase(std::find(changed_.begin(), changed_.end(), k));
  frames_.erase(k);
  frame_of_node_[at(node)] = -1;
  must_stay_[at(node)] = 1;
  const int onto = nearestInTime(k, gone.utc_ns);
  const Frame& to = frames_[at(onto)];
  retired_.push_back(
      {k, onto, to.T_odom_cam * solver_.pose(to.node).inverse() * pose * gone.T_odom_cam.inverse()});
  ++counters_.keyframes_retired;
  return true;
}

// One that few measurements name, as no keyframe that it served is left.
void NavigationGraph::retireReference() {
  const auto young = [&](const Reference& r) {
    constexpr double kNanoseconds = 1e9;
    return static_cast<double>(references_.back().utc_ns - r.utc_ns) <= config_.reference_s * kNanoseconds;
  };
  std::size_t best = references_.size(), fewest = kMostNamed + 1;
  for (int looked = 0; looked < std::min(kLookedAt, static_cast<int>(references_.size())); ++looked) {
    next_reference_ = (next_reference_ + 1) % references_.size();
    const Reference& r = references_[next_reference_];
    if (r.node == attitude_.node || r.node == depth_.node || r.node == tide_.node || young(r)) continue;
    std::size_t named = 0;
    for (int k = solver_.firstMeasurement(r.node); k >= 0 && named < fewest;
         k = solver_.nextMeasurement(k, r.node))
      ++named;
    if (named >= fewest) continue;
    fewest = named;
    best = next_reference_;
  }
  if (best == references_.size() || !retireNode(references_[best].node)) return;
  references_.erase(references_.begin() + static_cast<std::ptrdiff_t>(best));
  ++counters_.references_retired;
}

bool NavigationGraph::retireNode(int node) {
  struct Named {
    int measurement, other_end;
  };
  std::array<Named, kMostNamed> named;
  std::size_t count = 0;
  for (int k = solver_.firstMeasurement(node); k >= 0; k = solver_.nextMeasurement(k, node)) {
    if (count == named.size()) return false;
    const Measurement& m = solver_.measurement(k);
    named[count++] = {k, m.from == node ? m.to : m.from};
  }
  if (solver_.retire(node) != RetireStatus::kOk) return false;
  for (std::size_t i = 0; i < count; ++i) forget(named[i].measurement, named[i].other_end);
  return true;
}

// A measurement that went with a pose: its index is another's from now on.
void NavigationGraph::forget(int measurement, int other_end) {
  const int k = other_end < 0 ? -1 : frame_of_node_[at(other_end)];
  if (k >= 0) {
    Frame& frame = frames_[at(k)];
    if (frame.step == measurement) frame.step = -1;
    if (frame.attitude == measurement) frame.attitude = -1;
    if (frame.link == measurement) frame.link = -1;
  }
  for (const int newest : living().last(std::min<std::size_t>(living().size(), HeadingTrust::kWindow)))
    if (frames_[at(newest)].drift == measurement) frames_[at(newest)].drift = -1;
  const int robust = robust_of_[at(measurement)];
  if (robust < 0) return;
  robust_of_[at(measurement)] = -1;
  // Those before newest_robust_ have been looked at once, those behind it have not.
  auto hole = at(robust);
  if (hole < newest_robust_) {
    moveRobust(--newest_robust_, hole);
    hole = newest_robust_;
  }
  moveRobust(robust_.size() - 1, hole);
  robust_.pop_back();
  if (next_robust_ >= robust_.size()) next_robust_ = 0;
}

void NavigationGraph::moveRobust(std::size_t from, std::size_t to) {
  if (from == to) return;
  robust_[to] = robust_[from];
  robust_of_[at(robust_[to].measurement)] = static_cast<int>(to);
}

int NavigationGraph::nearestInTime(int keyframe, std::int64_t utc_ns) const {
  const std::span<const int> all = living();
  const std::size_t after = frames_.position(keyframe);
  if (after == all.size()) return all[after - 1];
  if (after == 0) return all[0];
  const std::int64_t since = utc_ns - utcNs(all[after - 1]), until = utcNs(all[after]) - utc_ns;
  return since < until ? all[after - 1] : all[after];
}

}  // namespace fathom::slam

#include "recon/slam/navigation_graph.hpp"

// Keyframes that moved, for who holds what they saw.
namespace fathom::slam {

void NavigationGraph::noteChanges() {
  for (const int node : solver_.moved()) {
    const int k = frame_of_node_[at(node)];
    if (k < 0 || frames_[at(k)].waiting) continue;
    Frame& frame = frames_[at(k)];
    const SE3 moved = frame.known.inverse() * solver_.pose(node);
    if (moved.translation().norm() <= config_.change_m &&
        2 * moved.rotation().vec().norm() <= config_.change_rad)
      continue;
    frame.waiting = true;
    changed_.push_back(k);
  }
}

std::optional<int> NavigationGraph::takeChange() {
  if (changed_.empty()) return std::nullopt;
  const auto moved = [&](int k) {
    const Frame& frame = frames_[at(k)];
    const SE3 by = frame.known.inverse() * solver_.pose(frame.node);
    return by.translation().norm() / config_.change_m + 2 * by.rotation().vec().norm() / config_.change_rad;
  };
  std::size_t best = 0;
  double most = moved(changed_[0]);
  for (std::size_t i = 1; i < changed_.size(); ++i)
    if (const double m = moved(changed_[i]); m > most || (m == most && changed_[i] > changed_[best])) {
      most = m;
      best = i;
    }
  const int k = changed_[best];
  changed_[best] = changed_.back();
  changed_.pop_back();
  Frame& frame = frames_[at(k)];
  frame.waiting = false;
  frame.known = solver_.pose(frame.node);
  return k;
}

void NavigationGraph::takeAllChanges() {
  for (const int k : changed_) {
    Frame& frame = frames_[at(k)];
    frame.waiting = false;
    frame.known = solver_.pose(frame.node);
  }
  changed_.clear();
}

}  // namespace fathom::slam

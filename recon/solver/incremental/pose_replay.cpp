#include "recon/solver/incremental/pose_replay.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace fathom::slam {

PoseReplay::PoseReplay(const PoseGraph& graph) : graph_(graph), first_(graph.poses.size() + 1, 0) {
  const int poses = static_cast<int>(graph.poses.size());
  for (const RelativePose& e : graph.edges) {
    if (e.from < kWorld || e.to < 0 || e.from >= poses || e.to >= poses)
      throw std::invalid_argument("pose graph: a measurement names a pose that is not there");
    ++first_[at(std::max(e.from, e.to)) + 1];
  }
  for (int i = 0; i < poses; ++i) first_[at(i) + 1] += first_[at(i)];
  std::vector<int> next(first_.begin(), first_.end() - 1);
  order_.resize(graph.edges.size());
  for (std::size_t k = 0; k < graph.edges.size(); ++k)
    order_[at(next[at(std::max(graph.edges[k].from, graph.edges[k].to))]++)] = static_cast<int>(k);
}

StepReport PoseReplay::step(IncrementalSolver& solver) {
  const std::span<const int> mine(order_.data() + first_[at(next_)], order_.data() + first_[at(next_) + 1]);
  int latest = -1;
  SE3 start = graph_.poses[at(next_)];
  for (const int k : mine) {
    const RelativePose& e = graph_.edges[at(k)];
    const int other = std::min(e.from, e.to);
    if (e.from == kWorld || other <= latest) continue;
    latest = other;
    start = solver.pose(other) * (e.from == other ? e.T_from_to : e.T_from_to.inverse());
  }
  if (solver.addPose(start) != AddStatus::kOk)
    throw std::invalid_argument("incremental solver: no room for pose " + std::to_string(next_));
  for (const int k : mine)
    if (solver.addMeasurement(graph_.edges[at(k)]) != AddStatus::kOk)
      throw std::invalid_argument("incremental solver: measurement " + std::to_string(k) + " is refused");
  ++next_;
  return solver.step();
}

}  // namespace fathom::slam

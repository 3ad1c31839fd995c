#include "recon/topside/localise/free_network.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "recon/navigation/sensors/sensor_factors.hpp"
#include "recon/solver/batch/batch_solver.hpp"

namespace fathom::topside {
namespace {

constexpr double kMaxChi2 = 22.46;  // of a closure, 99.9 % of chi-square with 6 degrees of freedom
constexpr double kGap = 2;          // between parts [m]

}  // namespace

FreeNetwork::FreeNetwork(const MissionInput& input, const Survey& survey, const FeatureStore& features)
    : rig_(input.rig), places_(framesOf(input, survey, features)), poses_(frames_.pair.size()) {
  frames_.travelled.assign(frames_.pair.size(), 0);
}

KnownPlaces FreeNetwork::framesOf(const MissionInput& input, const Survey& survey,
                                  const FeatureStore& features) {
  frames_.features = &features;
  std::vector<KnownPose> known;
  std::vector<Eigen::Vector3d> ground;
  for (std::uint32_t k = 0; k < survey.planes.size(); ++k) {
    if (features.count(k) == 0 || !survey.planes[k]) continue;
    known.push_back(survey.known.empty() ? KnownPose() : survey.known[k]);
    if (!frames_.pair.empty() && frames_.pair.back() + 1 != k) known.back().moved.reset();
    frames_.pair.push_back(k);
    frames_.range.push_back(survey.planes[k]->ahead());
    ground.push_back(survey.planes[k]->normal);
  }
  return {std::move(known), std::move(ground), input.mission.T_body_cam, input.mounted};
}

void FreeNetwork::solve() {
  constexpr double kNearWorst = 0.5;
  for (bool again = true; again;) {
    again = false;
    parts_.reset(poses_.size());
    slam::PoseGraph graph = linked();
    std::vector<slam::NavigationLink*> edges;
    for (slam::NavigationLink& link : links) {
      if (!link.kept) continue;
      parts_.join(link.a, link.b);
      edges.push_back(&link);
    }
    if (edges.empty()) return;
    converged_ = slam::optimize(graph, {}).converged;
    poses_ = graph.poses;
    double most = 0;
    for (std::size_t e = 0; e < edges.size(); ++e) {
      slam::NavigationLink& link = *edges[e];
      const Vector6d error = slam::relativePoseError(graph.edges[e], poses_[link.a], poses_[link.b]);
      link.chi2 = error.dot(graph.edges[e].information * error);
      if (!link.ofChain()) most = std::max(most, link.chi2);
    }
    for (slam::NavigationLink* link : edges)
      if (!link->ofChain() && link->chi2 > std::max(kMaxChi2, kNearWorst * most)) {
        link->kept = false;
        again = true;
      }
  }
  for (std::uint32_t k = 1; k < poses_.size(); ++k) {
    const bool joined = parts_.root(k - 1) == parts_.root(k);
    frames_.travelled[k] = frames_.travelled[k - 1] +
                           (joined ? (poses_[k].translation() - poses_[k - 1].translation()).norm() : 0);
  }
}

slam::PoseGraph FreeNetwork::linked() const {
  slam::PoseGraph graph;
  graph.poses = poses_;
  for (std::size_t k = 0; k < poses_.size(); ++k) graph.ids.push_back(static_cast<std::int64_t>(k));
  for (const slam::NavigationLink& link : links)
    if (link.kept)
      graph.edges.push_back(
          slam::linkFactor(static_cast<int>(link.a), static_cast<int>(link.b), link.T_a_b, link.covariance));
  return graph;
}

closure::Footprint FreeNetwork::footprint(std::uint32_t frame) const {
  return closure::footprintOf(poses_[frame], frames_.range[frame], rig_.left);
}

std::vector<FreeNetwork::Part> FreeNetwork::arrange() {
  std::map<std::uint32_t, Part> by_root;
  for (std::uint32_t k = 0; k < poses_.size(); ++k) by_root[parts_.root(k)].frames.push_back(k);
  std::vector<Part> parts;
  for (auto& [root, part] : by_root) {
    const KnownPlaces::Motion motion = places_.motionOf(part.frames, poses_);
    for (const std::uint32_t k : part.frames) poses_[k] = motion.T_nav_part * poses_[k];
    part.placed = motion.placed;
    parts.push_back(std::move(part));
  }
  if (places_.any()) (void)placed(parts);
  standApart(parts);
  return parts;
}

ControlResult FreeNetwork::hold(ControlNetwork& control, std::vector<Part>& parts, double scale_sigma) {
  std::vector<std::vector<std::uint32_t>> frames;
  for (const Part& part : parts) frames.push_back(part.frames);
  const double scale = control.scaleAt(frames, poses_);
  for (Part& part : parts) {
    for (const std::uint32_t k : part.frames) poses_[k] = grown(poses_[k], scale);
    const auto motion = control.motionOf(part.frames, poses_, !places_.any());
    if (!motion) continue;
    for (const std::uint32_t k : part.frames) poses_[k] = *motion * poses_[k];
    part.placed = true;
  }
  KnownPlaces::Placed network = placed(parts);
  ControlNetwork::Solved solved{&network.graph, {}, 0, {}, scale_sigma, scale};
  for (std::size_t k = 0; k < poses_.size(); ++k) solved.nodes.push_back(static_cast<int>(k) + 1);
  const auto kept = std::count_if(links.begin(), links.end(), [](const auto& link) { return link.kept; });
  for (std::ptrdiff_t k = 0; k < kept; ++k) solved.visual.push_back(static_cast<std::size_t>(k));
  ControlResult out = control.adjust(solved);
  converged_ = out.converged;
  takePoses(network.graph);
  standApart(parts);
  for (slam::NavigationLink& link : links) link.T_a_b = grown(link.T_a_b, out.scale);
  return out;
}

KnownPlaces::Placed FreeNetwork::placed(const std::vector<Part>& parts) {
  std::vector<std::uint32_t> firsts;
  for (const Part& part : parts) firsts.push_back(part.frames.front());
  KnownPlaces::Placed out = places_.improved(linked(), firsts);
  converged_ = out.converged;
  takePoses(out.graph);
  return out;
}

void FreeNetwork::takePoses(const slam::PoseGraph& in_nav) {
  std::copy_n(in_nav.poses.begin() + 1, poses_.size(), poses_.begin());
}

void FreeNetwork::standApart(const std::vector<Part>& parts) {
  std::optional<double> east;
  for (const bool placed : {true, false})
    for (const Part& part : parts)
      if (part.placed == placed) east = standAside(part, east);
}

double FreeNetwork::standAside(const Part& part, std::optional<double> edge) {
  double low = INFINITY, high = -INFINITY;
  for (const std::uint32_t k : part.frames) {
    const closure::Footprint f = footprint(k);
    low = std::min(low, f.centre.y() - f.radius);
    high = std::max(high, f.centre.y() + f.radius);
  }
  if (part.placed || !edge) return std::max(high, edge.value_or(high));
  const SE3 aside(Eigen::Quaterniond::Identity(), {0, *edge + kGap - low, 0});
  for (const std::uint32_t k : part.frames) poses_[k] = aside * poses_[k];
  return high + *edge + kGap - low;
}

}  // namespace fathom::topside

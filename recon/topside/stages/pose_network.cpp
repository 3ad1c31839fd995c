#include "recon/topside/stages/pose_network.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "recon/slam/batch_solver.hpp"

namespace fathom::topside {
namespace {

constexpr int kReweightings = 4;       // Cauchy's weights settle within three
constexpr int kRounds = 8;             // in which links are taken out and come back
constexpr double kRemovalShare = 0.5;  // of the worst link's chi2: those worse go first
constexpr double kCauchy2 = 6.0;       // chi2 at which a link keeps half its weight: what a good one has
constexpr double kNothing = 1e-12;     // information of what is not measured
constexpr int kWorld = 0;              // index of nav's origin in the graph; it is held

// Information about the residual [translation, quaternion's vector], which is half the rotation vector.
Matrix6d ofResidual(const Matrix6d& information) {
  Matrix6d scaled = information;
  scaled.topRightCorner<3, 3>() *= 2;
  scaled.bottomLeftCorner<3, 3>() *= 2;
  scaled.bottomRightCorner<3, 3>() *= 4;
  return 0.5 * (scaled + scaled.transpose());
}

// Standard deviations along nav's axes as the information about a perturbation in the axes of a pose.
Matrix6d informationInPose(const SE3& T_nav_pose, const Eigen::Vector3d& position,
                           const Eigen::Vector3d& rotation) {
  const Eigen::Matrix3d R = T_nav_pose.matrix3();
  const auto turned = [&](const Eigen::Vector3d& sigma) -> Eigen::Matrix3d {
    return R.transpose() * sigma.cwiseAbs2().cwiseInverse().asDiagonal() * R;
  };
  Matrix6d information = Matrix6d::Zero();
  information.topLeftCorner<3, 3>() = turned(position);
  information.bottomRightCorner<3, 3>() = turned(rotation);
  return information;
}

slam::RelativePose absolute(int node, const SE3& pose, const NetworkConfig& c, bool first) {
  const double nowhere = 1 / std::sqrt(kNothing), here = 1e-4;
  const double place = first ? here : nowhere;
  return {kWorld, node, pose,
          ofResidual(informationInPose(pose, {place, place, c.depth}, {c.tilt, c.tilt, c.heading}))};
}

slam::RelativePose step(int node, const SE3& from, const SE3& to, const NetworkConfig& c) {
  const SE3 between = from.inverse() * to;
  const double way = between.translation().norm();
  const double turn = Eigen::AngleAxisd(between.rotation()).angle();
  const double position = c.step_position + c.step_position_share * way;
  return {node, node + 1, between,
          ofResidual(
              informationInPose(to, Eigen::Vector3d::Constant(position),
                                {c.step_tilt, c.step_tilt, c.step_heading + c.step_heading_share * turn}))};
}

slam::RelativePose edgeOf(const CameraLink& link) {
  return {static_cast<int>(link.a) + 1, static_cast<int>(link.b) + 1, link.T_a_b,
          ofResidual(link.covariance.inverse())};
}

double chiSquareOf(const CameraLink& link, const std::vector<SE3>& nodes) {
  const slam::RelativePose edge = edgeOf(link);
  const Vector6d error = slam::relativePoseError(edge, nodes[link.a + 1], nodes[link.b + 1]);
  return error.dot(edge.information * error);
}

}  // namespace

std::vector<SE3> solveNetwork(const std::vector<SE3>& reckoned, std::vector<CameraLink>& links,
                              const NetworkConfig& config) {
  if (reckoned.empty()) return {};
  slam::PoseGraph graph;
  graph.poses.push_back(SE3());
  for (const SE3& pose : reckoned) graph.poses.push_back(pose);
  const int n = static_cast<int>(reckoned.size());
  for (int k = 0; k < n; ++k)
    graph.edges.push_back(absolute(k + 1, reckoned[static_cast<std::size_t>(k)], config, k == 0));
  for (int k = 0; k + 1 < n; ++k)
    graph.edges.push_back(step(k + 1, reckoned[static_cast<std::size_t>(k)],
                               reckoned[static_cast<std::size_t>(k) + 1], config));
  const std::size_t first_link = graph.edges.size();
  std::vector<std::size_t> link_of_edge;
  const auto rebuild = [&] {
    graph.edges.resize(first_link);
    link_of_edge.clear();
    for (std::size_t i = 0; i < links.size(); ++i) {
      if (!links[i].kept) continue;
      graph.edges.push_back(edgeOf(links[i]));
      link_of_edge.push_back(i);
    }
  };

  for (int round = 0; round <= kRounds; ++round) {
    rebuild();
    const std::vector<slam::RelativePose> full = graph.edges;
    for (int k = 0; k < kReweightings; ++k) {
      (void)slam::optimize(graph, {});
      for (std::size_t e = 0; e < link_of_edge.size(); ++e) {
        const double chi2 = chiSquareOf(links[link_of_edge[e]], graph.poses);
        graph.edges[first_link + e].information = full[first_link + e].information / (1 + chi2 / kCauchy2);
      }
    }
    double worst = 0;
    for (CameraLink& link : links) {
      link.chi2 = chiSquareOf(link, graph.poses);
      if (link.kept) worst = std::max(worst, link.chi2);
    }
    if (round == kRounds) break;
    // What was taken out comes back when it fits now: beside a bad link good ones look bad.
    bool changed = false;
    const double limit = std::max(config.max_chi2, kRemovalShare * worst);
    for (CameraLink& link : links) {
      const bool fits = link.chi2 <= (link.kept ? limit : config.max_chi2);
      changed = changed || fits != link.kept;
      link.kept = fits;
    }
    if (!changed) break;
  }
  return {graph.poses.begin() + 1, graph.poses.end()};
}

}  // namespace fathom::topside

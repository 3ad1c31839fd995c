// Three legs of dead reckoning and a loop closure that contradicts them: the most likely poses.
#include <cstdio>

#include "recon/solver/batch/batch_solver.hpp"

int main() {
  using namespace fathom;
  constexpr double kSigma = 0.1;  // of each number of a measurement [m]
  const Matrix6d information = Matrix6d::Identity() / (kSigma * kSigma);
  const SE3 leg(Eigen::Quaterniond::Identity(), {1.1, 0, 0});      // measured between neighbours
  const SE3 closure(Eigen::Quaterniond::Identity(), {3.0, 0, 0});  // measured from the first to the last

  slam::PoseGraph graph;
  graph.poses.emplace_back();
  for (int i = 0; i < 3; ++i) {
    graph.poses.push_back(graph.poses.back() * leg);
    graph.edges.push_back({i, i + 1, leg, information});
  }
  graph.edges.push_back({0, 3, closure, information});

  const slam::BatchResult result = slam::optimize(graph, {});
  if (!result.converged) return 1;
  std::printf("chi2 %.4f to %.4f\n", result.chi2_given, result.chi2);
  for (const SE3& pose : graph.poses)
    std::printf("%.4f %.4f %.4f\n", pose.translation().x(), pose.translation().y(), pose.translation().z());
}

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

#include "recon/geometry/uncertain_pose.hpp"
#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/batch/graph_covariance.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"
#include "recon/solver/incremental/shared_by_pose.hpp"
#include "tests/world/graphs.hpp"

namespace fathom::slam {
namespace {

// Lines there and back over a plane, each pose joined to the next and to the one beside it on the line
// before; the first is joined to the held pose 0.
PoseGraph lawnMower(int lines, int poses) {
  PoseGraph graph;
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  Vector6d sigma;
  sigma << 0.01, 0.01, 0.02, 0.002, 0.002, 0.004;
  const auto join = [&](int from, int to, double scale) {
    const auto &a = graph.poses[static_cast<std::size_t>(from)],
               &b = graph.poses[static_cast<std::size_t>(to)];
    RelativePose edge{from, to, a.inverse() * b, Matrix6d::Zero()};
    edge.information.diagonal() = (scale * sigma).cwiseAbs2().cwiseInverse();
    graph.edges.push_back(edge);
  };
  graph.poses.emplace_back();
  for (int line = 0; line < lines; ++line) {
    for (int k = 0; k < poses; ++k) {
      const double along = 0.25 * (line % 2 == 0 ? k : poses - 1 - k), heading = line % 2 == 0 ? 0 : M_PI;
      graph.poses.push_back(SE3::fromEuler(0.05 * normal(random), 0.05 * normal(random), heading,
                                           {200 + along, 50 + 1.0 * line, 10 + 0.1 * normal(random)}));
      const int here = static_cast<int>(graph.poses.size()) - 1;
      join(here - 1, here, here == 1 ? 30 : 1);
      if (line > 0 && k % 3 == 0) join(here - 1 - 2 * k, here, 2);
    }
  }
  return graph;
}

TEST(GraphCovariance, IsThatOfTheWholeInverseForEveryPair) {
  const PoseGraph graph = lawnMower(4, 12);
  const Eigen::MatrixXd dense = covarianceOf(graph.poses, graph.edges);
  const GraphCovariance known(graph);
  const int count = static_cast<int>(graph.poses.size());
  for (int a = 1; a < count; a += 5) {
    const Matrix6d own = jointOf(dense, a, a).topLeftCorner<6, 6>();
    EXPECT_LT((known.of(a) - own).norm(), 1e-6 * own.norm()) << a;
    for (int b = a + 1; b < count; b += 7) {
      const SE3 &T_w_a = graph.poses[static_cast<std::size_t>(a)],
                &T_w_b = graph.poses[static_cast<std::size_t>(b)];
      // Derivatives of T_a_b are those of an edge that measures it.
      const RelativePoseLinear l =
          linearize({a, b, T_w_a.inverse() * T_w_b, Matrix6d::Identity()}, T_w_a, T_w_b);
      Eigen::Matrix<double, 6, 12> J;
      J << l.by_from, l.by_to;
      J.bottomRows<3>() *= 2;  // half angles
      const Matrix6d between = J * jointOf(dense, a, b) * J.transpose();
      EXPECT_LT((known.between(a, b) - between).norm(), 1e-6 * between.norm()) << a << " " << b;
      // Horizontal places in nav.
      Eigen::Matrix<double, 2, 12> P = Eigen::Matrix<double, 2, 12>::Zero();
      P.block<2, 3>(0, 0) = -T_w_a.matrix3().topRows<2>();
      P.block<2, 3>(0, 6) = T_w_b.matrix3().topRows<2>();
      const Eigen::Matrix2d places = P * jointOf(dense, a, b) * P.transpose();
      const Eigen::Matrix2d separation =
          GraphCovariance::separation(known.placePathOf(a), known.placePathOf(b));
      EXPECT_LT((separation - places).norm(), 1e-6 * places.norm()) << a << " " << b;
    }
  }
}

TEST(GraphCovariance, ThePoseThatIsHeldHasNoneAndItselfNoneToItself) {
  const GraphCovariance known(lawnMower(2, 5));
  EXPECT_EQ(known.of(0).norm(), 0);
  EXPECT_EQ(known.between(4, 4).norm(), 0);
  EXPECT_LT((known.between(0, 3) - known.of(3)).norm(), 1e-9 * known.of(3).norm());
}

TEST(GraphCovariance, ACommonScaleWidensThePathBetweenTwoPoses) {
  PoseGraph graph = lawnMower(1, 20);
  for (RelativePose& e : graph.edges) e.T_from_to = SE3::fromEuler(0, 0, 0, e.T_from_to.translation());
  const GraphCovariance plain(graph), scaled(graph, 0.01, {1, 20});
  const double path = (graph.poses[1].translation() - graph.poses[20].translation()).norm();
  EXPECT_NEAR((scaled.between(1, 20) - plain.between(1, 20)).trace(), std::pow(0.01 * path, 2), 1e-9);
}

// Against the poses of a graph whose turns are larger, where a fix of a place and closures are not.
TEST(GraphCovariance, ACommonScaleWidensWhatTurnsMove) {
  constexpr double kScale = 1e-4;
  PoseGraph graph = lawnMower(4, 20);
  graph.edges.push_back({0, 70, graph.poses[70], Matrix6d::Identity() * 1e4});
  std::vector<int> scaled;
  for (int k = 1; k < static_cast<int>(graph.poses.size()); ++k) scaled.push_back(k);
  const GraphCovariance plain(graph), known(graph, kScale, scaled);
  PoseGraph larger = graph;
  for (RelativePose& e : larger.edges) {
    if (e.from == 0) continue;
    Vector6d turn = Vector6d::Zero();
    turn.tail<3>() = kScale * e.T_from_to.log().tail<3>();
    e.T_from_to = e.T_from_to * SE3::exp(turn);
  }
  optimize(larger, {});
  const auto seen = [](const PoseGraph& of, int a, int b) {
    return of.poses[static_cast<std::size_t>(a)].inverse() * of.poses[static_cast<std::size_t>(b)];
  };
  for (const int k : {2, 20, 35, 80}) {
    const Vector6d moved = (seen(graph, 1, k).inverse() * seen(larger, 1, k)).log();
    const Eigen::Vector3d path = kScale * seen(graph, k, 1).translation();
    Matrix6d expected = moved * moved.transpose();
    expected.topLeftCorner<3, 3>() += path * path.transpose();
    const Matrix6d wider = known.between(1, k) - plain.between(1, k);
    EXPECT_LT((wider - expected).norm(), 0.01 * expected.norm()) << k;
  }
}

// A survey, and where its poses are by edges of which all but those from pose 0 err by the same perturbation.
struct SharedError {
  SharedError() {
    each << 2e-4, -1e-4, 5e-5, 1e-4, 5e-5, 2e-4;
    graph.edges.push_back({0, 70, graph.poses[70], Matrix6d::Identity() * 1e4});
    off = graph;
    for (RelativePose& e : off.edges)
      if (e.from != 0) e.T_from_to = e.T_from_to * SE3::exp(each);
    optimize(off, {});
  }
  // So many times that error, of each edge that has it, in a column of what edges share.
  [[nodiscard]] std::vector<GraphCovariance::SharedByEdge> byEdge(int column, double times) const {
    std::vector<GraphCovariance::SharedByEdge> shared;
    for (std::size_t k = 0; k < graph.edges.size(); ++k) {
      if (graph.edges[k].from == 0) continue;
      shared.push_back({k, GraphCovariance::ByShared::Zero()});
      shared.back().error.col(column) = times * each;
    }
    return shared;
  }
  // By which a pose, as pose 1 sees it, is moved, squared.
  [[nodiscard]] Matrix6d squared(int k) const {
    const auto seen = [k](const PoseGraph& of) {
      return of.poses[1].inverse() * of.poses[static_cast<std::size_t>(k)];
    };
    const Vector6d moved = (seen(graph).inverse() * seen(off)).log();
    return moved * moved.transpose();
  }

  Vector6d each;
  PoseGraph graph = lawnMower(4, 20), off;
};

// What poses claim of each other grows by what it moves.
TEST(GraphCovariance, WhatEdgesShareWidensWhatItMoves) {
  const SharedError error;
  const PoseGraph& graph = error.graph;
  const GraphCovariance plain(graph), known(graph, 0, {}, error.byEdge(3, 1));
  for (const int k : {2, 20, 35, 80}) {
    const Matrix6d expected = error.squared(k), wider = known.between(1, k) - plain.between(1, k);
    EXPECT_LT((wider - expected).norm(), 0.02 * expected.norm()) << k;
  }
}

// A sensor that is wrong without knowing it bends the poses against their links: no error of the rig.
TEST(GraphCovariance, WhatEdgesShareIsNotWhatOtherEdgesGetWrong) {
  const SharedError error;
  PoseGraph bent = error.graph;
  constexpr int kColumn = GraphCovariance::kShared - 1;
  Vector6d wrong;
  wrong << 0.3, -0.2, 0.1, 0.1, -0.2, 0.3;
  for (const int pose : {12, 25, 44, 61}) {
    const auto at = static_cast<std::size_t>(pose);
    bent.edges.push_back(
        {0, pose, bent.poses[at] * SE3::exp((pose % 2 == 0 ? 1 : -1) * wrong), Matrix6d::Identity() * 1e6});
  }
  optimize(bent, {});
  EXPECT_LT(std::abs(GraphCovariance(bent, 0, {}, error.byEdge(kColumn, 1)).shared()(kColumn)), 2);
}

// Closures contradict what the steps between share: poses and the error are found together.
TEST(GraphCovariance, EstimatesWhatEdgesShareByWhereTheyContradictEachOther) {
  const SharedError error;
  constexpr double kErr = 2;      // the error in standard deviations of what is known before
  constexpr double kSharp = 400;  // so that noise of edges leaves little of it open
  constexpr int kColumn = GraphCovariance::kShared - 1;
  const std::vector<GraphCovariance::SharedByEdge> shared = error.byEdge(kColumn, 10);
  PoseGraph truth = error.graph;
  for (RelativePose& e : truth.edges) e.information *= kSharp;
  PoseGraph off = truth;
  const auto err = [&](double by) {
    for (const auto& [edge, errors] : shared)
      off.edges[edge].T_from_to = off.edges[edge].T_from_to * SE3::exp(by * errors.col(kColumn));
    optimize(off, {});
  };
  err(kErr);
  const PoseGraph first = off;
  const GraphCovariance as_seen(first, 0, {}, shared);
  EXPECT_NEAR(as_seen.shared()(kColumn), kErr, 0.05);
  EXPECT_EQ(as_seen.shared().head<kColumn>().norm(), 0);
  err(-as_seen.shared()(kColumn));
  const GraphCovariance plain(truth), known(off, 0, {}, shared, as_seen.shared());
  EXPECT_NEAR(known.shared()(kColumn), kErr, 0.01);
  const auto seen = [](const PoseGraph& of, int k) {
    return of.poses[1].inverse() * of.poses[static_cast<std::size_t>(k)];
  };
  for (const int k : {20, 35, 80}) {
    const double left = (seen(truth, k).inverse() * seen(off, k)).log().norm(),
                 uncorrected = (seen(truth, k).inverse() * seen(first, k)).log().norm();
    EXPECT_LT(left, 0.05 * uncorrected) << k;
    // Little of it is left open.
    EXPECT_LT(known.between(1, k).trace(), 1.2 * plain.between(1, k).trace()) << k;
  }
}

// The same by the factor of a graph that grows.
TEST(SharedByPose, WhatMeasurementsShareWidensWhatItMoves) {
  const SharedError error;
  IncrementalConfig config{.max_poses = 100, .max_measurements = 200, .max_factor_blocks = 4000};
  IncrementalSolver solver(config);
  for (const SE3& pose : error.graph.poses) ASSERT_EQ(solver.addPose(pose), AddStatus::kOk);
  for (const RelativePose& e : error.graph.edges) ASSERT_EQ(solver.addMeasurement(e), AddStatus::kOk);
  for (int i = 0; i < 10; ++i) (void)solver.step();
  SharedByPose shared(config.max_poses);
  SharedByPose::Each each = SharedByPose::Each::Zero();
  each.col(2) = error.each;
  shared.begin();
  for (int k = 0; k < solver.measurements(); ++k)
    if (solver.measurement(k).from != 0) shared.add(solver, k, each);
  while (!shared.solve(solver)) continue;
  const SharedByPose::Covariance variance = 4 * SharedByPose::Covariance::Identity();
  for (const int k : {2, 20, 35, 80}) {
    const Matrix6d expected = 4 * error.squared(k), found = shared.covariance(1, k, solver.pose(k), variance);
    EXPECT_LT((found - expected).norm(), 0.02 * expected.norm()) << k;
  }
}

TEST(GraphCovariance, RefusesAnEdgeToAPoseThatIsNotThere) {
  PoseGraph graph = lawnMower(1, 3);
  graph.edges.front().to = 9;
  EXPECT_THROW(GraphCovariance{graph}, std::invalid_argument);
}

TEST(GraphCovariance, MemoryFollowsTheFactorAndPathsFollowItsSeparators) {
  const PoseGraph small = lawnMower(16, 64), large = lawnMower(32, 128);  // four times the poses
  const GraphCovariance of_small(small), of_large(large);
  EXPECT_LT(of_large.memoryBytes(), 64U * 1024 * 1024);
  EXPECT_LT(static_cast<double>(of_large.memoryBytes()), 6.5 * static_cast<double>(of_small.memoryBytes()));
  // A path to the root has about twice the rows, not four times.
  const auto longest = [](const GraphCovariance& known, int poses) {
    Eigen::Index rows = 0;
    for (int k = 1; k < poses; k += 13) rows = std::max(rows, known.pathOf(k).value.rows());
    return static_cast<double>(rows);
  };
  EXPECT_LT(longest(of_large, 32 * 128), 3 * longest(of_small, 16 * 64));
  // Of a dive of hours: 1,464 rows, and 2,556 in the order of the sparsest factor.
  constexpr int kLines = 64, kPoses = 256;
  EXPECT_LT(longest(GraphCovariance(lawnMower(kLines, kPoses)), kLines * kPoses), 2000);
}

TEST(TreePathCache, GivesTheSamePathsWhateverItHasRoomFor) {
  const PoseGraph graph = lawnMower(4, 20);
  const GraphCovariance known(graph);
  TreePathCache narrow(known, &GraphCovariance::pathOf, 1),
      wide(known, &GraphCovariance::pathOf, std::size_t{1} << 30);
  for (const int a : {3, 40, 3, 70, 41}) {
    for (const int b : {5, 40, 60}) {
      const GraphCovariance::TreePath &a_narrow = narrow.of(a), &b_narrow = narrow.of(b);
      const Matrix6d by_narrow = known.between(a, a_narrow, b, b_narrow);
      EXPECT_EQ((by_narrow - known.between(a, wide.of(a), b, wide.of(b))).norm(), 0);
    }
  }
}

}  // namespace
}  // namespace fathom::slam

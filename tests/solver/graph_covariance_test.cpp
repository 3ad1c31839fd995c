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
  std::vector<GraphCovariance::SharedByEdge> shared;
  for (std::size_t k = 0; k < graph.edges.size(); ++k) {
    if (graph.edges[k].from == 0) continue;
    shared.push_back({k, GraphCovariance::ByShared::Zero()});
    shared.back().error.col(3) = error.each;
  }
  const GraphCovariance plain(graph), known(graph, 0, {}, shared);
  for (const int k : {2, 20, 35, 80}) {
    const Matrix6d expected = error.squared(k), wider = known.between(1, k) - plain.between(1, k);
    EXPECT_LT((wider - expected).norm(), 0.02 * expected.norm()) << k;
  }
}

// A sensor that is wrong without knowing it bends the poses against their links: no error of the rig.
TEST(GraphCovariance, WhatEdgesShareIsNotWhatOtherEdgesGetWrong) {
  const SharedError error;
  PoseGraph bent = error.graph;
  std::vector<GraphCovariance::SharedByEdge> shared;
  for (std::size_t k = 0; k < bent.edges.size(); ++k) {
    if (bent.edges[k].from == 0) continue;
    shared.push_back({k, GraphCovariance::ByShared::Zero()});
    shared.back().error.col(GraphCovariance::kShared - 1) = error.each;
  }
  Vector6d wrong;
  wrong << 0.3, -0.2, 0.1, 0.1, -0.2, 0.3;
  for (const int pose : {12, 25, 44, 61}) {
    const auto at = static_cast<std::size_t>(pose);
    bent.edges.push_back(
        {0, pose, bent.poses[at] * SE3::exp((pose % 2 == 0 ? 1 : -1) * wrong), Matrix6d::Identity() * 1e6});
  }
  optimize(bent, {});
  EXPECT_LT(std::abs(GraphCovariance(bent, 0, {}, shared).shared()(GraphCovariance::kShared - 1)), 2);
}

// Closures contradict what the steps between share: poses and the error are found together.
TEST(GraphCovariance, EstimatesWhatEdgesShareByWhereTheyContradictEachOther) {
  const SharedError error;
  constexpr double kErr = 2;      // the error in standard deviations of what is known before
  constexpr double kSharp = 400;  // so that noise of edges leaves little of it open
  constexpr int kColumn = GraphCovariance::kShared - 1;
  std::vector<GraphCovariance::SharedByEdge> shared;
  for (std::size_t k = 0; k < error.graph.edges.size(); ++k) {
    if (error.graph.edges[k].from == 0) continue;
    shared.push_back({k, GraphCovariance::ByShared::Zero()});
    shared.back().error.col(kColumn) = 10 * error.each;
  }
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

constexpr double kShift = 0.02, kTurn = 0.004;  // standard deviations of a measurement [m], [rad]

Matrix6d informationOfLink() {
  Vector6d diagonal;
  // The residual's last three numbers are half angles.
  diagonal << Eigen::Vector3d::Constant(1 / (kShift * kShift)),
      Eigen::Vector3d::Constant(4 / (kTurn * kTurn));
  return diagonal.asDiagonal();
}

// A vehicle that goes round and round, in a pool of poses: each new one
// takes the place of one that is retired, and is joined to the pose before
// it and to those it comes near. Noise is not that of the informations.
class Rounds {
 public:
  static constexpr int kPool = 30, kRound = 24, kKept = 8;

  Rounds(std::int64_t quota, unsigned seed) : solver_(configOf(quota)), random_(seed) {}

  void addOne() {
    const double angle = 2 * 3.14159265358979 * born_ / kRound;
    const SE3 truth = SE3::fromEuler(0, 0.1, angle, {5 * std::cos(angle), 5 * std::sin(angle), 0.01 * born_});
    if (solver_.living() == kPool && !retireOne()) return;
    int index = -1;
    SE3 start = truth;
    if (last_ >= 0) start = solver_.pose(last_) * (truths_[at(last_)].inverse() * truth) * noise(1);
    ASSERT_EQ(solver_.addPose(start, &index), AddStatus::kOk);
    if (at(index) == truths_.size()) truths_.emplace_back();
    truths_[at(index)] = truth;
    ++born_;
    for (int other = 0; other < solver_.size(); ++other) {
      if (other == index || solver_.isRetired(other)) continue;
      const SE3 between = truths_[at(other)].inverse() * truth;
      if (other != last_ && between.translation().norm() > 1) continue;
      int k = -1;
      ASSERT_EQ(solver_.addMeasurement({other, index, between * noise(0.7), informationOfLink()}, &k),
                AddStatus::kOk);
      if (other != last_ && k % 3 == 0) (void)solver_.setWeight(k, 0.5);
    }
    last_ = index;
  }

  // As a batch solver has the measurements that are left: the farthest pose [m, rad], and the least and the
  // greatest of a variance by the solver over the true one.
  struct Comparison {
    double distance = 0, least = 1e9, greatest = 0;
  };
  Comparison compare() {
    const std::vector<RelativePose> edges = measurementsOf(solver_);
    std::vector<SE3> poses;
    for (int i = 0; i < solver_.size(); ++i) poses.push_back(solver_.pose(i));
    for (int round = 0; round < 5; ++round) step(poses, edges);
    const Eigen::MatrixXd truth = covarianceOf(poses, edges);
    Comparison c;
    for (int i = 1; i < solver_.size(); ++i) {
      c.distance = std::max(c.distance, (poses[at(i)].inverse() * solver_.pose(i)).log().norm());
      const Vector6d ratio =
          relativeEigenvalues(solver_.covariance(i), truth.block<6, 6>(6 * (i - 1), 6 * (i - 1)));
      c.least = std::min(c.least, ratio(0));
      c.greatest = std::max(c.greatest, ratio(5));
    }
    return c;
  }

  IncrementalSolver& solver() { return solver_; }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  static IncrementalConfig configOf(std::int64_t quota) {
    IncrementalConfig config{.max_poses = kPool, .max_measurements = 400, .max_factor_blocks = 2000};
    config.build_quota = config.urgent_quota = quota;
    config.rebuild_after = 1;  // one factor after the other
    config.kept_last = 8;
    return config;
  }

  bool retireOne() {
    const int old = solver_.leastNeeded(kKept);
    return old >= 0 && solver_.retire(old) == RetireStatus::kOk;
  }

  SE3 noise(double scale) {
    Vector6d x;
    for (int i = 0; i < 6; ++i) x(i) = scale * (i < 3 ? kShift : kTurn) * normal_(random_);
    return SE3::exp(x);
  }

  static void step(std::vector<SE3>& poses, const std::vector<RelativePose>& edges) {
    const auto n = static_cast<Eigen::Index>(6 * poses.size());
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(n);
    for (const RelativePose& e : edges) {
      const RelativePoseLinear l = linearize(e, poses[at(e.from)], poses[at(e.to)]);
      gradient.segment<6>(6 * e.from) += l.by_from.transpose() * e.information * l.error;
      gradient.segment<6>(6 * e.to) += l.by_to.transpose() * e.information * l.error;
    }
    const Eigen::VectorXd move =
        informationOf(poses, edges).bottomRightCorner(n - 6, n - 6).llt().solve(-gradient.tail(n - 6));
    for (std::size_t i = 1; i < poses.size(); ++i)
      poses[i] = perturbed(poses[i], move.segment<6>(6 * static_cast<Eigen::Index>(i - 1)));
  }

  IncrementalSolver solver_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  std::vector<SE3> truths_;  // by index
  int born_ = 0, last_ = -1;
};

// Slices of the next factor from a column or two to all of it, so that poses come and go at many moments of
// its making: before, between and after its columns, while it takes in what is new, and when it is taken up.
TEST(Retirement, AtAnyMomentOfTheNextFactorLeavesSolutionAndCovariancesOfABatch) {
  for (const std::int64_t quota : {40, 70, 110, 160, 240, 400, 700, 1200, 5000}) {
    Rounds rounds(quota, static_cast<unsigned>(quota));
    for (int i = 0; i < 240; ++i) {
      rounds.addOne();
      // A pose that went while the factor was built has no part in it when it is taken up.
      if (rounds.solver().step().factors_replaced > 0) {
        EXPECT_LT(rounds.compare().greatest, 1.09) << "quota " << quota << ", pose " << i;
      }
      if (i % 40 != 39) continue;
      for (int k = 0; k < 40; ++k) (void)rounds.solver().step();
      const Rounds::Comparison c = rounds.compare();
      EXPECT_LT(c.distance, 8e-4) << "quota " << quota << ", pose " << i;
      EXPECT_GT(c.least, 0.88) << "quota " << quota << ", pose " << i;
      EXPECT_LT(c.greatest, 1.06) << "quota " << quota << ", pose " << i;
    }
    EXPECT_GT(rounds.solver().retired(), 100) << "quota " << quota;
  }
}

}  // namespace
}  // namespace fathom::slam

#include "recon/solver/incremental/incremental_solver.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <random>
#include <stdexcept>
#include <vector>

#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/incremental/pose_replay.hpp"
#include "recon/solver/pose_graph.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/graphs.hpp"

namespace fathom::slam {
namespace {

IncrementalConfig sizedFor(const PoseGraph& graph) {
  return IncrementalConfig{.max_poses = static_cast<int>(graph.poses.size()),
                           .max_measurements = static_cast<int>(graph.edges.size()),
                           .max_factor_blocks = 100000};
}

PoseGraph graphFromFile(const char* name, int poses) {
  PoseGraph graph = readG2o(test::dataFile(std::string("posegraph/") + name));
  if (poses < static_cast<int>(graph.poses.size())) {
    graph.poses.resize(static_cast<std::size_t>(poses));
    std::erase_if(graph.edges, [&](const RelativePose& e) { return std::max(e.from, e.to) >= poses; });
  }
  return graph;
}

// A walk through a room with noisy odometry, and noisy measurements between poses that come close.
PoseGraph walk(int poses, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto noise = [&](double shift, double turn) {
    Vector6d x;
    for (int i = 0; i < 6; ++i) x(i) = (i < 3 ? shift : turn) * normal(random);
    return SE3::exp(x);
  };
  Matrix6d information = Matrix6d::Identity() / (0.05 * 0.05);
  information.bottomRightCorner<3, 3>() *= 4 * 6.25;  // 0.01 rad, of half angles
  PoseGraph graph;
  std::vector<SE3> truth;
  for (int i = 0; i < poses; ++i) {
    truth.push_back(i == 0 ? SE3()
                           : truth.back() * SE3::fromEuler(0, 0.02, 0.35, {1, 0, 0}) * noise(0.2, 0.1));
    graph.poses.push_back(i == 0 ? SE3() : SE3::fromEuler(1, 1, 1, {9, 9, 9}));
    for (int k = 0; k < i; ++k) {
      if (k + 1 < i &&
          ((truth[static_cast<std::size_t>(k)].translation() - truth.back().translation()).norm() > 1 ||
           normal(random) < 0))
        continue;
      const SE3 between = truth[static_cast<std::size_t>(k)].inverse() * truth.back();
      graph.edges.push_back({k, i, between * noise(0.05, 0.01), information});
    }
  }
  return graph;
}

double worstDistance(const IncrementalSolver& solver, const PoseGraph& graph) {
  double worst = 0;
  for (int i = 0; i < solver.size(); ++i)
    worst =
        std::max(worst, (graph.poses[static_cast<std::size_t>(i)].inverse() * solver.pose(i)).log().norm());
  return worst;
}

TEST(IncrementalSolver, EveryStepOfARandomWalkEndsAtTheBatchSolution) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const PoseGraph whole = walk(60, seed);
    IncrementalSolver solver(sizedFor(whole));
    PoseReplay replay(whole);
    PoseGraph grown;
    for (int i = 0; i < 60; ++i) {
      const StepReport report = replay.step(solver);
      grown.poses.push_back(solver.pose(i));
      for (const RelativePose& e : whole.edges)
        if (std::max(e.from, e.to) == i) grown.edges.push_back(e);
      if (i % 6 != 5) continue;
      PoseGraph batch = grown;
      for (int k = 0; k <= i; ++k) batch.poses[static_cast<std::size_t>(k)] = solver.pose(k);
      const BatchResult best = optimize(batch, {});
      EXPECT_NEAR(report.chi2, best.chi2, 1e-5 * best.chi2 + 1e-6) << "seed " << seed << " step " << i;
      EXPECT_LT(worstDistance(solver, batch), 6e-4) << "seed " << seed << " step " << i;
    }
  }
}

struct GrowingDataset {
  const char* file;
  int poses;      // of the file, first ones
  double excess;  // of chi2 over the batch solution's after the last step, relative
};

class IncrementalSolverOn : public ::testing::TestWithParam<GrowingDataset> {};

TEST_P(IncrementalSolverOn, PoseByPoseTheBatchOptimumIsReachedWithoutAHeapCall) {
  FATHOM_REQUIRE_DATA(std::string("posegraph/") + GetParam().file);
  PoseGraph graph = graphFromFile(GetParam().file, GetParam().poses);
  IncrementalSolver solver(sizedFor(graph));
  PoseReplay replay(graph);
  const test::ThreadCost before = test::threadCost();
  StepReport last;
  while (!replay.done()) last = replay.step(solver);
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0U);
  EXPECT_EQ(last.measurements_waiting, 0);
  const BatchResult best = optimize(graph, {});
  EXPECT_GE(last.chi2, best.chi2 * (1 - 1e-6));
  EXPECT_LE(last.chi2, best.chi2 * (1 + GetParam().excess));
  for (std::size_t i = 0; i < graph.poses.size(); ++i) graph.poses[i] = solver.pose(static_cast<int>(i));
  EXPECT_NEAR(chiSquare(graph), last.chi2, 1e-9 * last.chi2) << "what it reports is what it has";
}

INSTANTIATE_TEST_SUITE_P(RealGraphs, IncrementalSolverOn,
                         ::testing::Values(GrowingDataset{"tinyGrid3D.g2o", 9, 1e-4},
                                           GrowingDataset{"parking-garage.g2o", 1661, 1e-4},
                                           GrowingDataset{"sphere2500.g2o", 800, 1e-4}),
                         [](const auto& graph) {
                           const std::string name = graph.param.file;
                           return name[0] == 't' ? "TinyGrid" : name[0] == 'p' ? "Garage" : "Sphere";
                         });

TEST(IncrementalSolver, ASmallQuotaForFactorsOnlyDelaysTheSolution) {
  FATHOM_REQUIRE_DATA("posegraph/parking-garage.g2o");
  PoseGraph graph = graphFromFile("parking-garage.g2o", 900);
  IncrementalConfig config = sizedFor(graph);
  config.urgent_quota = config.build_quota = 20000;
  IncrementalSolver solver(config);
  std::int64_t most = 0;
  for (PoseReplay replay(graph); !replay.done();) most = std::max(most, replay.step(solver).build_work);
  EXPECT_LT(most, 60000) << "a slice, and the order of elimination, which is found in one piece";
  for (int i = 0; i < 40; ++i) solver.step();
  const BatchResult best = optimize(graph, {});
  EXPECT_LE(solver.chi2(), best.chi2 * (1 + 1e-4));
}

TEST(IncrementalSolver, TheSameCallsGiveTheSameBits) {
  const PoseGraph graph = walk(80, 3);
  IncrementalSolver a(sizedFor(graph)), b(sizedFor(graph));
  PoseReplay replay_a(graph), replay_b(graph);
  while (!replay_a.done()) {
    const StepReport one = replay_a.step(a), two = replay_b.step(b);
    ASSERT_EQ(one.chi2, two.chi2);
    ASSERT_EQ(one.build_work, two.build_work);
  }
  for (int i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a.pose(i).translation(), b.pose(i).translation());
    EXPECT_EQ(a.pose(i).rotation().coeffs(), b.pose(i).rotation().coeffs());
  }
}

TEST(IncrementalSolver, AFalseClosureThatIsTakenOutLeavesTheSolutionWithoutIt) {
  PoseGraph graph = walk(60, 2);
  IncrementalConfig config = sizedFor(graph);
  ++config.max_measurements;
  IncrementalSolver solver(config);
  for (PoseReplay replay(graph); !replay.done();) replay.step(solver);
  const double without = solver.chi2();
  const int closure = solver.measurements();
  ASSERT_EQ(solver.addMeasurement({5, 40, SE3::fromEuler(0, 0, 2, {3, 4, 5}), 100 * Matrix6d::Identity()}),
            AddStatus::kOk);
  for (int i = 0; i < 10; ++i) solver.step();
  EXPECT_GT(solver.chi2(), 2 * without);
  EXPECT_GT(solver.chi2Of(closure), 1);
  EXPECT_FALSE(solver.forget(closure));
  EXPECT_TRUE(solver.setWeight(closure, 0));
  EXPECT_FALSE(solver.forget(closure));  // the factor still has it
  for (int i = 0; i < 10; ++i) solver.step();
  optimize(graph, {});
  EXPECT_NEAR(solver.chi2(), without, 1e-5 * without);
  EXPECT_EQ(solver.chi2Of(closure), 0);
  EXPECT_FALSE(solver.setWeight(closure + 1, 0));
  EXPECT_FALSE(solver.setWeight(closure, -1));
  EXPECT_TRUE(solver.forget(closure));
  EXPECT_FALSE(solver.forget(closure));
  int next = -1;
  ASSERT_EQ(
      solver.addMeasurement({5, 6, graph.poses[5].inverse() * graph.poses[6], Matrix6d::Identity()}, &next),
      AddStatus::kOk);
  EXPECT_EQ(next, closure);
  for (int i = 0; i < 10; ++i) solver.step();
  EXPECT_NEAR(solver.chi2(), without, 1e-5 * without);
}

TEST(IncrementalSolver, MeasurementsOfThePoseItselfPullItIntoTheWorld) {
  IncrementalSolver solver({.max_poses = 3, .max_measurements = 5, .max_factor_blocks = 10});
  Matrix6d depth = Matrix6d::Zero();
  depth(2, 2) = 100;
  ASSERT_EQ(solver.addPose(SE3()), AddStatus::kOk);
  ASSERT_EQ(solver.addPose(SE3::fromEuler(0, 0, 0, {1, 0, 0})), AddStatus::kOk);
  ASSERT_EQ(solver.addMeasurement({0, 1, SE3::fromEuler(0, 0, 0, {1, 0, 0}), 100 * Matrix6d::Identity()}),
            AddStatus::kOk);
  ASSERT_EQ(solver.addMeasurement({kWorld, 1, SE3::fromEuler(0, 0, 0, {0, 0, 2}), depth}), AddStatus::kOk);
  for (int i = 0; i < 5; ++i) solver.step();
  EXPECT_NEAR(solver.pose(1).translation().z(), 1, 1e-6) << "in the middle between two equal measurements";
  EXPECT_NEAR(solver.pose(1).translation().x(), 1, 1e-6);
  EXPECT_NEAR(solver.covariance(1)(2, 2), 1.0 / 200, 1e-9);
}

TEST(IncrementalSolver, CovariancesAreThoseOfTheDenseNormalEquations) {
  PoseGraph graph = walk(30, 4);
  IncrementalSolver solver(sizedFor(graph));
  for (PoseReplay replay(graph); !replay.done();) replay.step(solver);
  for (int i = 0; i < 5; ++i) solver.step();
  std::vector<SE3> poses;
  for (int i = 0; i < solver.size(); ++i) poses.push_back(solver.pose(i));
  Eigen::MatrixXd information = informationOf(poses, graph.edges);
  information.topLeftCorner<6, 6>() += 1e9 * Matrix6d::Identity();  // held
  const Eigen::MatrixXd inverse = information.inverse();
  const Matrix6d expected = inverse.block<6, 6>(6 * 29, 6 * 29);
  EXPECT_LT((solver.covariance(29) - expected).norm(), 0.05 * expected.norm())
      << "the factor's linearisation may be a little older";
  EXPECT_TRUE(solver.covariance(0).isZero());
  // Of T_7_29, by differences of its two ends.
  Eigen::Matrix<double, 6, 12> by;
  const SE3 T = solver.pose(7).inverse() * solver.pose(29);
  for (int i = 0; i < 12; ++i) {
    constexpr double kStep = 1e-6;
    Vector6d x = Vector6d::Zero();
    x(i % 6) = kStep;
    const SE3 moved = i < 6 ? perturbed(solver.pose(7), x).inverse() * solver.pose(29)
                            : solver.pose(7).inverse() * perturbed(solver.pose(29), x);
    const SE3 change = T.inverse() * moved;
    by.col(i) << change.translation() / kStep, 2 * change.rotation().vec() / kStep;
  }
  Eigen::Matrix<double, 12, 12> both;
  both << inverse.block<6, 6>(42, 42), inverse.block<6, 6>(42, 174), inverse.block<6, 6>(174, 42), expected;
  const Matrix6d relative = by * both * by.transpose();
  EXPECT_LT((solver.relativeCovariance(7, 29) - relative).norm(), 0.05 * relative.norm());
  EXPECT_TRUE(solver.relativeCovariance(7, 7).isZero());
}

TEST(IncrementalSolver, WhatDoesNotFitOrCannotBeIsRefusedAndTheRestGoesOn) {
  IncrementalConfig config{.max_poses = 2, .max_measurements = 1, .max_factor_blocks = 1};
  IncrementalSolver solver(config);
  const SE3 ahead = SE3::fromEuler(0, 0, 0, {1, 0, 0});
  EXPECT_EQ(solver.addPose(SE3()), AddStatus::kOk);
  EXPECT_EQ(solver.addPose(SE3()), AddStatus::kOk);
  EXPECT_EQ(solver.addPose(SE3()), AddStatus::kFull);
  EXPECT_EQ(solver.addMeasurement({0, 2, ahead, Matrix6d::Identity()}), AddStatus::kNoSuchPose);
  EXPECT_EQ(solver.addMeasurement({-2, 1, ahead, Matrix6d::Identity()}), AddStatus::kNoSuchPose);
  EXPECT_EQ(solver.addMeasurement({1, 1, ahead, Matrix6d::Identity()}), AddStatus::kBadMeasurement);
  EXPECT_EQ(solver.addMeasurement({0, 1, ahead, -Matrix6d::Identity()}), AddStatus::kBadMeasurement);
  EXPECT_EQ(solver.addMeasurement({0, 1, ahead, NAN * Matrix6d::Identity()}), AddStatus::kBadMeasurement);
  EXPECT_EQ(solver.addMeasurement({0, 1, ahead, Matrix6d::Identity()}), AddStatus::kOk);
  EXPECT_EQ(solver.addMeasurement({0, 1, ahead, Matrix6d::Identity()}), AddStatus::kFull);
  solver.step();
  EXPECT_NEAR(solver.pose(1).translation().x(), 1, 1e-9);
  ASSERT_EQ(solver.moved().size(), 1U);
  EXPECT_EQ(solver.moved()[0], 1);
  config.iterations = 0;
  EXPECT_THROW(IncrementalSolver{config}, std::invalid_argument);
}

TEST(IncrementalSolver, WithoutRoomForAllOfAFactorItStillFindsTheSolutionSlowly) {
  PoseGraph graph = walk(60, 1);
  IncrementalConfig config = sizedFor(graph);
  config.max_factor_blocks = 90;
  config.iterations = 20;
  IncrementalSolver solver(config);
  for (PoseReplay replay(graph); !replay.done();) replay.step(solver);
  EXPECT_GT(solver.leftOut(), 0);
  for (int i = 0; i < 60; ++i) solver.step();
  const BatchResult best = optimize(graph, {});
  EXPECT_NEAR(solver.chi2(), best.chi2, 1e-2 * best.chi2);
}

TEST(IncrementalSolver, ItsMemoryIsWhatItAsksForBeforehand) {
  const IncrementalConfig config;
  IncrementalSolver solver(config);
  EXPECT_GE(solver.memoryBytes(), IncrementalSolver::bytesNeeded(config));
  EXPECT_LT(solver.memoryBytes(), IncrementalSolver::bytesNeeded(config) + 4096);
}

// A chain that is stiff, and held softly: forces within it, each too small to matter where it pulls, must not
// be lost before they reach the held pose.
TEST(IncrementalSolver, WhatIsHeldSoftlyStaysWhileStiffStepsAreAdded) {
  constexpr double kStep = 0.5, kSharp = 3e-4, kSoft = 1;  // [m]
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  IncrementalConfig config{.max_poses = 300, .max_measurements = 400};
  IncrementalSolver solver(config);
  ASSERT_EQ(solver.addPose(SE3()), AddStatus::kOk);
  const SE3 first(Eigen::Quaterniond::Identity(), {5, -4, 2}),
      step(Eigen::Quaterniond::Identity(), {kStep, 0, 0});
  const auto noise = [&](double sigma) {
    Vector6d e;
    for (int i = 0; i < 6; ++i) e(i) = sigma * normal(random);
    return SE3::exp(e);
  };
  double worst = 0;
  ASSERT_EQ(solver.addPose(first), AddStatus::kOk);
  ASSERT_EQ(solver.addMeasurement({0, 1, first, Matrix6d::Identity() / (kSoft * kSoft)}), AddStatus::kOk);
  for (int k = 2; k < config.max_poses; ++k) {
    ASSERT_EQ(solver.addPose(solver.pose(k - 1) * step * noise(0.01)), AddStatus::kOk);
    const Matrix6d sharp = Matrix6d::Identity() / (kSharp * kSharp);
    ASSERT_EQ(solver.addMeasurement({k - 1, k, step * noise(kSharp), sharp}), AddStatus::kOk);
    if (k % 20 == 0) {
      const SE3 seen = solver.pose(1).inverse() * solver.pose(k) * noise(0.01);
      ASSERT_EQ(solver.addMeasurement({1, k, seen, 0.1 * sharp}), AddStatus::kOk);
    }
    (void)solver.step();
    worst = std::max(worst, (solver.pose(1).translation() - first.translation()).norm());
  }
  EXPECT_LT(worst, 0.004);
}

}  // namespace
}  // namespace fathom::slam

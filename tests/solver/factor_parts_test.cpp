#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <random>
#include <vector>

#include "recon/geometry/uncertain_pose.hpp"
#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/batch/block_cholesky.hpp"
#include "recon/solver/incremental/factor_builder.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"
#include "recon/solver/incremental/pose_replay.hpp"
#include "tests/world/graphs.hpp"

namespace fathom::slam {
namespace {

TEST(BlockCholesky, SolvesWhatADenseSolverSolvesInEitherOrderOfPairs) {
  constexpr int kBlocks = 30, kSize = 3;
  std::mt19937 random(4);
  std::uniform_int_distribution<int> any(0, kBlocks - 1);
  std::vector<BlockCholesky::Pair> pairs;
  for (int i = 1; i < kBlocks; ++i) pairs.push_back({i, i - 1});
  for (int i = 0; i < 25; ++i) {
    const int a = any(random), b = any(random);
    if (a != b) pairs.push_back({a, b});
  }
  pairs.push_back(pairs.front());  // once more
  BlockCholesky system(kBlocks, kSize, pairs);
  for (int round = 0; round < 2; ++round) {  // the second time over the first one's values
    system.setZero();
    Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(kBlocks * kSize, kBlocks * kSize);
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const Eigen::Matrix3d m = Eigen::Matrix3d::Random();
      system.addPair(k, m);
      dense.block<kSize, kSize>(pairs[k][0] * kSize, pairs[k][1] * kSize) += m;
      dense.block<kSize, kSize>(pairs[k][1] * kSize, pairs[k][0] * kSize) += m.transpose();
    }
    const Eigen::Matrix3d heavy = 30 * Eigen::Matrix3d::Identity() + Eigen::Matrix3d::Ones();
    for (int i = 0; i < kBlocks; ++i) {
      system.addDiagonal(i, heavy);
      dense.block<kSize, kSize>(i * kSize, i * kSize) += heavy;
    }
    const Eigen::MatrixXd right = Eigen::MatrixXd::Random(kBlocks * kSize, 2);
    ASSERT_TRUE(system.factorize());
    EXPECT_LT((dense * system.solve(right) - right).norm(), 1e-10);
    ASSERT_TRUE(system.factorize(0.5));
    Eigen::MatrixXd damped = dense;
    damped.diagonal() *= 1.5;
    EXPECT_LT((damped * system.solve(right) - right).norm(), 1e-10);
  }
}

TEST(BlockCholesky, AMatrixThatIsNotPositiveDefiniteIsRefused) {
  const std::vector<BlockCholesky::Pair> pairs{{0, 1}};
  BlockCholesky system(2, 1, pairs);
  system.addDiagonal(0, Eigen::MatrixXd::Ones(1, 1));
  system.addDiagonal(1, Eigen::MatrixXd::Ones(1, 1));
  system.addPair(0, 2 * Eigen::MatrixXd::Ones(1, 1));
  EXPECT_FALSE(system.factorize());
  EXPECT_TRUE(system.factorize(2));
}

constexpr int kBuilderPoses = 40, kMeasurements = 120, kBlocks = 1000;
constexpr int kAhead = 3;  // each pose is measured from so many before it

SE3 poseOf(int i) {
  return SE3::fromEuler(0.01 * i, -0.02 * i, 0.1 * i, {0.3 * i, 0.05 * i * i, 8.0 - 0.01 * i});
}

RelativePose measured(int from, int to, double sigma) {
  return {from, to, poseOf(from).inverse() * poseOf(to), Matrix6d::Identity() / (sigma * sigma)};
}

// A graph, and the factor that is built of it a slice at a time.
struct Built {
  static constexpr FactorBuilder::Size kSize{kBuilderPoses, kMeasurements, 10};
  static constexpr GrowingFactor::Size kFactor{kBuilderPoses, kBuilderPoses, kBlocks};
  rt::Arena arena{Measurements::bytes(kBuilderPoses, kMeasurements) + FactorBuilder::bytes(kSize) +
                  GrowingFactor::bytes(kFactor)};
  Measurements measurements{kBuilderPoses, kMeasurements, arena};
  FactorBuilder builder{kSize, arena};
  GrowingFactor factor{kFactor, arena};
  std::vector<InFactor> in_factor{kMeasurements};

  Built() {
    std::vector<SE3> poses;
    for (int i = 0; i < kBuilderPoses; ++i) {
      poses.push_back(poseOf(i));
      for (int from = std::max(0, i - kAhead); from < i; ++from)
        EXPECT_EQ(measurements.add(measured(from, i, 0.1 + 0.01 * i), kBuilderPoses), AddStatus::kOk);
    }
    std::vector<std::uint8_t> held(kBuilderPoses), newest(kBuilderPoses), left_out(kMeasurements);
    held[0] = 1;
    (void)builder.begin(poses, held, newest, left_out, measurements, 0, factor);
  }
  [[nodiscard]] std::vector<double> solution() {
    std::vector<double> right(6 * kBuilderPoses), x(6 * kBuilderPoses);
    for (std::size_t i = 0; i < right.size(); ++i) right[i] = 0.1 * static_cast<double>(i % 7);
    (void)factor.solve(right.data(), x.data(), 0);
    return x;
  }
  // Gives a measurement's place to one that says something else.
  [[nodiscard]] bool giveAway(int k) {
    measurements.remove(k);
    if (!builder.keep(measurements.nextPlace())) return false;
    int place = -1;
    EXPECT_EQ(measurements.add(measured(kBuilderPoses - 1, k % 5, 3), kBuilderPoses, &place), AddStatus::kOk);
    EXPECT_EQ(place, k);
    return true;
  }
};

TEST(FactorBuilder, BuildsWhatWasThereAtTheStartThoughPlacesBecomeOthers) {
  Built quiet, busy;
  (void)quiet.builder.run(1'000'000, quiet.factor, quiet.in_factor);
  for (int k = 0; k < 10; ++k) {
    (void)busy.builder.run(1, busy.factor, busy.in_factor);
    ASSERT_TRUE(busy.builder.running());
    ASSERT_TRUE(busy.giveAway(11 * k));
    ASSERT_TRUE(busy.giveAway(11 * k)) << "what was kept once need not be kept again";
    busy.measurements.setWeight(11 * k + 1, 0.5);
  }
  (void)busy.builder.run(1'000'000, busy.factor, busy.in_factor);
  EXPECT_EQ(busy.solution(), quiet.solution());
}

TEST(FactorBuilder, SaysWhenTooManyPlacesBecomeOthers) {
  Built built;
  (void)built.builder.run(1, built.factor, built.in_factor);
  for (int k = 0; k < 10; ++k) ASSERT_TRUE(built.giveAway(k));
  EXPECT_FALSE(built.giveAway(10));
  (void)built.builder.run(1'000'000, built.factor, built.in_factor);
  EXPECT_TRUE(built.giveAway(11)) << "nothing is read any more";
}

// Every pose and measurement is another's before a factor is built: it is
// begun again, and poses to come wait until one is.
TEST(FactorBuilder, ASolverContinuesWhenAllPlacesChangeDuringABuild) {
  IncrementalConfig config{.max_poses = 80, .max_measurements = 600, .max_factor_blocks = 8000};
  config.build_quota = config.urgent_quota = 30;
  IncrementalSolver solver(config);
  constexpr int kSteps = 600, kOfPose = 5;
  int last = -1, added = 0;
  ASSERT_EQ(solver.addPose(SE3(), &last), AddStatus::kOk);
  const SE3 step = SE3::fromEuler(0, 0, 0.01, {0.3, 0, 0});
  SE3 truth;
  for (int i = 0; i < 10 * kSteps && added < kSteps; ++i) {
    if (solver.living() > 60)
      if (const int pose = solver.leastNeeded(8); pose >= 0) (void)solver.retire(pose);
    int next = -1;
    if (solver.addPose(solver.pose(last) * step, &next) == AddStatus::kOk) {
      truth = truth * step;
      ASSERT_EQ(solver.addMeasurement({last, next, step, 100 * Matrix6d::Identity()}), AddStatus::kOk);
      for (int k = 0; k < kOfPose; ++k)
        ASSERT_EQ(solver.addMeasurement({kWorld, next, truth, Matrix6d::Identity()}), AddStatus::kOk);
      last = next;
      ++added;
    }
    (void)solver.step();
  }
  EXPECT_EQ(added, kSteps);
  EXPECT_GT(solver.retired(), kSteps / 2);
  EXPECT_NEAR((solver.pose(last).translation() - truth.translation()).norm(), 0, 1e-6);
}

constexpr int kStorePoses = 240;

PoseGraph surveyWithClosuresAnywhere() {
  test::SurveyPlan plan{
      .keyframes = kStorePoses, .closures = 80, .where = test::Closures::kAnywhere, .line_length = 30};
  return test::makeSurvey(plan).graph;
}

IncrementalSolver solverFor(const PoseGraph& graph, std::int64_t blocks) {
  return IncrementalSolver({.max_poses = kStorePoses,
                            .max_measurements = static_cast<int>(graph.edges.size()),
                            .max_factor_blocks = blocks});
}

// Mean work of the last quarter of the steps.
double replayed(IncrementalSolver& solver, const PoseGraph& graph) {
  double work = 0;
  int step = 0;
  for (PoseReplay replay(graph); !replay.done(); ++step) {
    const StepReport report = replay.step(solver);
    if (step >= kStorePoses * 3 / 4)
      work += static_cast<double>(report.solve_work + report.update_work + report.build_work);
  }
  return work / (kStorePoses / 4);
}

constexpr std::int64_t kAmple = 20000, kScarce = 700, kBarelyTheChain = 270;

TEST(FactorStore, WhenItIsFullTheWorkOfAStepStaysNearTheUsual) {
  const PoseGraph graph = surveyWithClosuresAnywhere();
  IncrementalSolver ample = solverFor(graph, kAmple);
  const double usual = replayed(ample, graph);
  EXPECT_EQ(ample.leftOut(), 0);
  EXPECT_GT(ample.factorBlocks(), kScarce);
  for (const std::int64_t blocks : {kScarce, kBarelyTheChain}) {
    IncrementalSolver scarce = solverFor(graph, blocks);
    // Conjugate gradients with less of a factor take more iterations, which are bounded.
    EXPECT_LT(replayed(scarce, graph), 4 * usual) << blocks;
    EXPECT_GT(scarce.leftOut(), 0) << blocks;
  }
}

TEST(FactorStore, WithoutRoomForAllTheSolutionIsStillThatOfAllMeasurements) {
  PoseGraph graph = surveyWithClosuresAnywhere();
  IncrementalSolver scarce = solverFor(graph, kScarce);
  (void)replayed(scarce, graph);
  for (int i = 0; i < 100; ++i) scarce.step();
  const BatchResult best = optimize(graph, {});
  EXPECT_NEAR(scarce.chi2(), best.chi2, 1e-3 * best.chi2);
}

TEST(FactorStore, WhatIsLeftOutForWantOfRoomMakesNoCovarianceSmallerThanTheTruth) {
  const PoseGraph graph = surveyWithClosuresAnywhere();
  for (const std::int64_t blocks : {kScarce, kBarelyTheChain}) {
    IncrementalSolver scarce = solverFor(graph, blocks);
    (void)replayed(scarce, graph);
    for (int i = 0; i < 100; ++i) scarce.step();
    ASSERT_GT(scarce.leftOut(), 0);
    std::vector<SE3> poses;
    for (int i = 0; i < scarce.size(); ++i) poses.push_back(scarce.pose(i));
    const Eigen::MatrixXd truth = covarianceOf(poses, measurementsOf(scarce));
    for (int i = 10; i < kStorePoses; i += 10) {
      const Vector6d ratio =
          relativeEigenvalues(scarce.covariance(i), truth.block<6, 6>(6 * (i - 1), 6 * (i - 1)));
      EXPECT_GT(ratio(0), 0.98) << blocks << " blocks, pose " << i;
    }
  }
}

TEST(FactorStore, WithoutRoomEvenForWhatJoinsPosesNothingIsClaimedAndTheWorkIsBounded) {
  const PoseGraph graph = surveyWithClosuresAnywhere();
  IncrementalSolver none = solverFor(graph, 20);
  const double work = replayed(none, graph);
  IncrementalSolver ample = solverFor(graph, kAmple);
  EXPECT_LT(work, replayed(ample, graph));
  EXPECT_GT(none.covariance(kStorePoses - 1)(0, 0), 1e6) << "not known [m^2]";
}

}  // namespace
}  // namespace fathom::slam

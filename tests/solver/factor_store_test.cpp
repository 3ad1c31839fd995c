#include <gtest/gtest.h>

#include <algorithm>

#include "recon/geometry/symmetric_eigen.hpp"
#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"
#include "recon/solver/incremental/pose_replay.hpp"
#include "tests/solver/dense_graph.hpp"
#include "tests/solver/survey_graph.hpp"

namespace fathom::slam {
namespace {

constexpr int kStorePoses = 240;

PoseGraph surveyWithClosuresAnywhere() {
  test::SurveyPlan plan;
  plan.keyframes = kStorePoses;
  plan.closures = 80;
  plan.line_length = 30;
  plan.where = test::Closures::kAnywhere;
  return test::makeSurvey(plan).graph;
}

IncrementalSolver solverFor(const PoseGraph& graph, std::int64_t blocks) {
  IncrementalConfig config;
  config.max_poses = kStorePoses;
  config.max_measurements = static_cast<int>(graph.edges.size());
  config.max_factor_blocks = blocks;
  return IncrementalSolver(config);
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

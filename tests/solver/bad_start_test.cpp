#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {
namespace {

constexpr int kTrackPoses = 40;

// A winding track, measured without error, and some closures between any two of its poses.
PoseGraph perfectWalk(int closures, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  PoseGraph graph;
  const auto measure = [&](std::size_t a, std::size_t b) {
    graph.edges.push_back({static_cast<int>(a), static_cast<int>(b),
                           graph.poses[a].inverse() * graph.poses[b], 100 * Matrix6d::Identity()});
  };
  for (std::size_t i = 0; i < kTrackPoses; ++i) {
    Vector6d sway;
    for (int k = 0; k < 6; ++k) sway(k) = (k < 3 ? 0.2 : 0.1) * normal(random);
    graph.poses.push_back(
        i == 0 ? SE3() : graph.poses.back() * SE3::fromEuler(0, 0.02, 0.35, {1, 0, 0}) * SE3::exp(sway));
    if (i > 0) measure(i - 1, i);
  }
  for (int k = 0; k < closures; ++k) {
    const std::size_t a = random() % kTrackPoses, b = random() % kTrackPoses;
    if (a != b) measure(a, b);
  }
  return graph;
}

// Adds all of a graph, with poses thrown from their places by `shift` [m] and `turn` [rad].
void addThrown(IncrementalSolver& solver, const PoseGraph& graph, double shift, double turn, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  for (std::size_t i = 0; i < graph.poses.size(); ++i) {
    Vector6d by;
    for (int k = 0; k < 6; ++k) by(k) = (k < 3 ? shift : turn) * normal(random);
    ASSERT_EQ(solver.addPose(i == 0 ? graph.poses[i] : graph.poses[i] * SE3::exp(by)), AddStatus::kOk);
  }
  for (const RelativePose& edge : graph.edges) ASSERT_EQ(solver.addMeasurement(edge), AddStatus::kOk);
}

IncrementalConfig configFor(const PoseGraph& graph) {
  IncrementalConfig config;
  config.max_poses = static_cast<int>(graph.poses.size());
  config.max_measurements = static_cast<int>(graph.edges.size()) + 1;
  config.max_factor_blocks = 2000;
  return config;
}

struct BadStart {
  const char* name;
  double shift, turn;
  int closures;
};

class IncrementalSolverFrom : public ::testing::TestWithParam<BadStart> {};

TEST_P(IncrementalSolverFrom, AnyBadStartPerfectMeasurementsEndWithoutError) {
  constexpr unsigned kSeeds = 12;
  constexpr int kSteps = 34;  // twice what the slowest of these needs
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const PoseGraph graph = perfectWalk(GetParam().closures, seed);
    IncrementalSolver solver(configFor(graph));
    addThrown(solver, graph, GetParam().shift, GetParam().turn, 100 + seed);
    StepReport report;
    for (int i = 0; i < kSteps; ++i) report = solver.step();
    EXPECT_LT(report.chi2, 1e-9) << "seed " << seed;
    EXPECT_FALSE(report.waits_for_factor) << "seed " << seed;
    report = solver.step();
    EXPECT_EQ(report.iterations + report.factors_replaced, 0) << "at rest nothing is done, seed " << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(BadStarts, IncrementalSolverFrom,
                         ::testing::Values(BadStart{"ChainTurned", 3, 1, 0}, BadStart{"ChainAnyhow", 9, 3, 0},
                                           BadStart{"LoopsTurned", 3, 1, 20},
                                           BadStart{"LoopsAnyhow", 9, 3, 20},
                                           BadStart{"ManyLoopsAnyhow", 9, 3, 80}),
                         [](const auto& start) { return std::string(start.param.name); });

TEST(IncrementalSolver, ChiSquareRisesOnlyToFallFurther) {
  for (unsigned seed = 1; seed <= 12; ++seed) {
    const PoseGraph graph = perfectWalk(30, seed);
    IncrementalSolver solver(configFor(graph));
    addThrown(solver, graph, 5, 2, seed);
    double least = std::numeric_limits<double>::infinity();
    StepReport report;
    for (int i = 0; i < 30; ++i) {
      report = solver.step();
      EXPECT_LE(report.chi2, 4 * least) << "seed " << seed << " step " << i;
      least = std::min(least, report.chi2);
    }
    EXPECT_EQ(report.chi2, least) << "seed " << seed;
  }
}

TEST(IncrementalSolver, MeasurementsThatContradictEachOtherEndAtRestToo) {
  for (unsigned seed = 1; seed <= 12; ++seed) {
    PoseGraph graph = perfectWalk(10, seed);
    // Half a turn too much: between two directions, equally long.
    graph.edges.back().T_from_to =
        graph.edges.back().T_from_to * SE3::fromEuler(0, 0, std::acos(-1.0), {0, 0, 0});
    IncrementalSolver solver(configFor(graph));
    addThrown(solver, graph, 9, 3, seed);
    StepReport report;
    for (int i = 0; i < 200; ++i) report = solver.step();
    EXPECT_EQ(report.iterations + report.factors_replaced, 0) << "seed " << seed;
    EXPECT_FALSE(report.waits_for_factor) << "seed " << seed;
  }
}

}  // namespace
}  // namespace fathom::slam

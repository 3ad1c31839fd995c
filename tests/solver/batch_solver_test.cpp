#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/batch/bundle_adjustment.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"
#include "recon/solver/pose_graph.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::slam {
namespace {

struct BatchOptimum {
  const char* file;
  double chi2;  // global optimum as certified by SE-Sync and agreed on by GTSAM
};

class BatchSolverOn : public ::testing::TestWithParam<BatchOptimum> {};

TEST_P(BatchSolverOn, ThePublishedOptimumIsFoundFromTheFilesGuess) {
  FATHOM_REQUIRE_DATA(std::string("posegraph/") + GetParam().file);
  PoseGraph graph = readG2o(test::dataFile(std::string("posegraph/") + GetParam().file));
  const BatchResult result = optimize(graph, {});
  EXPECT_TRUE(result.converged);
  EXPECT_NEAR(result.chi2, GetParam().chi2, 1e-4 * GetParam().chi2);
  EXPECT_NEAR(chiSquare(graph), result.chi2, 1e-9 * result.chi2);
  std::printf("%s: %.6f after %d iterations\n", GetParam().file, result.chi2, result.iterations);
}

TEST_P(BatchSolverOn, TheSameOptimumIsFoundFromNonsense) {
  FATHOM_REQUIRE_DATA(std::string("posegraph/") + GetParam().file);
  PoseGraph graph = readG2o(test::dataFile(std::string("posegraph/") + GetParam().file));
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (SE3& pose : graph.poses) {
    Vector6d twist;
    for (int i = 0; i < 6; ++i) twist(i) = 10 * normal(random);
    pose = SE3::exp(twist);
  }
  const BatchResult result = optimize(graph, {});
  EXPECT_TRUE(result.chordal);
  EXPECT_NEAR(result.chi2, GetParam().chi2, 1e-4 * GetParam().chi2);
}

INSTANTIATE_TEST_SUITE_P(RealGraphs, BatchSolverOn,
                         ::testing::Values(BatchOptimum{"tinyGrid3D.g2o", 6.727881},
                                           BatchOptimum{"parking-garage.g2o", 1.238684},
                                           BatchOptimum{"sphere2500.g2o", 727.149412}),
                         [](const auto& graph) {
                           const std::string name = graph.param.file;
                           return name[0] == 't' ? "TinyGrid" : name[0] == 'p' ? "Garage" : "Sphere";
                         });

// A square of four poses, one metre a side.
PoseGraph square() {
  PoseGraph graph;
  const SE3 step = SE3::fromEuler(0, 0, std::acos(-1.0) / 2, {1, 0, 0});
  graph.poses = {SE3(), step, step * step, step * step * step};
  for (int i = 0; i < 4; ++i) graph.edges.push_back({i, (i + 1) % 4, step, Matrix6d::Identity()});
  return graph;
}

TEST(BatchSolver, APerfectGraphIsLeftAsItIsAndPartsKeepTheirFirstPose) {
  PoseGraph graph = square();
  const PoseGraph other = square();
  const SE3 away = SE3::fromEuler(0.1, 0.2, 0.3, {100, 50, 2});
  for (const SE3& pose : other.poses) graph.poses.push_back(away * pose);
  for (RelativePose edge : other.edges) {
    edge.from += 4;
    edge.to += 4;
    graph.edges.push_back(edge);
  }
  graph.poses.push_back(SE3::fromEuler(0, 0, 1, {7, 7, 7}));  // alone
  const std::vector<SE3> before = graph.poses;
  const BatchResult result = optimize(graph, {});
  EXPECT_TRUE(result.converged);
  EXPECT_LT(result.chi2, 1e-20);
  for (std::size_t i = 0; i < before.size(); ++i)
    EXPECT_LT((graph.poses[i].translation() - before[i].translation()).norm(), 1e-9) << i;
}

TEST(BatchSolver, GraphsThatCannotBeAreRefused) {
  PoseGraph graph = square();
  graph.edges[0].to = 4;
  EXPECT_THROW(optimize(graph, {}), std::invalid_argument);
  graph = square();
  graph.edges[0].to = graph.edges[0].from;
  EXPECT_THROW(optimize(graph, {}), std::invalid_argument);
  graph = square();
  graph.edges[0].information(0, 1) = 5;
  EXPECT_THROW(optimize(graph, {}), std::invalid_argument);
  graph = square();
  graph.edges[0].information(0, 1) = graph.edges[0].information(1, 0) = 2;  // eigenvalues 3 and -1
  EXPECT_THROW(optimize(graph, {}), std::invalid_argument);
  EXPECT_THROW((void)chordalPoses(graph), std::invalid_argument);
  PoseGraph empty;
  EXPECT_TRUE(optimize(empty, {}).converged);
}

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
  return IncrementalConfig{.max_poses = static_cast<int>(graph.poses.size()),
                           .max_measurements = static_cast<int>(graph.edges.size()) + 1,
                           .max_factor_blocks = 2000};
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

// A rig 2 m above uneven ground, along a line and back beside it; every
// point is seen where it falls into both images.
struct SyntheticBundle {
  Bundle bundle;
  std::vector<SE3> truth;

  SyntheticBundle(double noise, double wrong, double false_share = 0) {
    Camera camera{.width = 1360, .height = 1024};
    camera.fx = camera.fy = 1770;
    camera.cx = 679.5;
    camera.cy = 511.5;
    camera.k1 = -0.1;
    bundle.rig = {camera, camera, SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0})};
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    constexpr int kFrames = 24;
    constexpr double kStep = 0.2, kBeside = 0.5;
    for (int k = 0; k < kFrames; ++k) {
      const bool back = k >= kFrames / 2;
      const double x = back ? (kFrames - 1 - k) * kStep : k * kStep;
      truth.push_back(SE3::fromEuler(0.02 * normal(random), 0.02 * normal(random), back ? M_PI : 0,
                                     {x, back ? kBeside : 0, 0.05 * normal(random)}));
      Vector6d off;
      for (int i = 0; i < 6; ++i) off(i) = wrong * normal(random);
      bundle.graph.poses.push_back(k == 0 ? truth[0] : truth[static_cast<std::size_t>(k)] * SE3::exp(off));
      bundle.graph.ids.push_back(k);
      bundle.nodes.push_back(k);
    }
    std::uniform_real_distribution<double> along(-0.8, 3), across(-0.6, 1.1), up(0, 0.3), share(0, 1);
    bundle.first = {0};
    for (int p = 0; p < 900; ++p) {
      const Eigen::Vector3d place(along(random), across(random), 2.1 - up(random));
      const std::size_t before = bundle.sightings.size();
      for (std::uint32_t k = 0; k < kFrames; ++k) {
        const Eigen::Vector3d here = truth[k].inverse() * place;
        const Eigen::Vector2d left = camera.project(here),
                              right = camera.project(bundle.rig.T_right_left * here);
        if (!camera.contains(left, 5) || !camera.contains(right, 5)) continue;
        Eigen::Vector2d n(noise * normal(random), noise * normal(random));
        if (share(random) < false_share) n += Eigen::Vector2d(4, -6);
        bundle.sightings.push_back({k, (left + n).cast<float>(), (right + n).cast<float>()});
      }
      if (bundle.sightings.size() < before + 2)
        bundle.sightings.resize(before);
      else
        bundle.first.push_back(static_cast<std::uint32_t>(bundle.sightings.size()));
    }
  }

  [[nodiscard]] double worst() const {
    double most = 0;
    for (std::size_t k = 0; k < truth.size(); ++k)
      most = std::max(most, (bundle.graph.poses[k].translation() - truth[k].translation()).norm());
    return most;
  }
};

TEST(BundleAdjustment, FindsThePosesOfPerfectSightings) {
  SyntheticBundle synthetic(0, 0.02);
  ASSERT_GT(synthetic.worst(), 0.02);
  const BundleResult result = adjust(synthetic.bundle, {});
  EXPECT_TRUE(result.converged);
  EXPECT_GT(result.place_before, 2.5);
  EXPECT_LT(result.place_after, 0.001);
  EXPECT_LT(synthetic.worst(), 2e-5) << "pixels are of 32 bits";
}

TEST(BundleAdjustment, FindsTheNoiseAndIsAsGoodAsIt) {
  SyntheticBundle synthetic(0.2, 0.02);
  const BundleResult result = adjust(synthetic.bundle, {});
  EXPECT_TRUE(result.converged);
  EXPECT_NEAR(result.place, 0.2, 0.04) << "of what a robust weight leaves";
  EXPECT_LT(synthetic.worst(), 0.003);
}

TEST(BundleAdjustment, FalseSightingsPullLittle) {
  SyntheticBundle clean(0.1, 0.01), soiled(0.1, 0.01, 0.05);
  (void)adjust(clean.bundle, {});
  (void)adjust(soiled.bundle, {});
  EXPECT_LT(soiled.worst(), 2 * clean.worst() + 0.0005);
}

TEST(BundleAdjustment, ScaleIsTheBaselinesAndEdgesCount) {
  SyntheticBundle synthetic(0.1, 0.01);
  // An edge that is surer than all points: the second frame half a metre on.
  synthetic.bundle.graph.edges.push_back({.from = 0,
                                          .to = 1,
                                          .T_from_to = SE3(Eigen::Quaterniond::Identity(), {0.5, 0, 0}),
                                          .information = 1e12 * Matrix6d::Identity()});
  (void)adjust(synthetic.bundle, {});
  const SE3 step = synthetic.bundle.graph.poses[0].inverse() * synthetic.bundle.graph.poses[1];
  EXPECT_NEAR(step.translation().x(), 0.5, 0.001);
}

TEST(BundleAdjustment, NothingIsLeftAsItIs) {
  Bundle empty;
  EXPECT_EQ(adjust(empty, {}).points, 0U);
  SyntheticBundle synthetic(0, 0.02);
  synthetic.bundle.sightings.clear();
  synthetic.bundle.first = {0};
  const SE3 before = synthetic.bundle.graph.poses[3];
  EXPECT_EQ(adjust(synthetic.bundle, {}).points, 0U);
  EXPECT_EQ((before.inverse() * synthetic.bundle.graph.poses[3]).log().norm(), 0);
}

}  // namespace
}  // namespace fathom::slam

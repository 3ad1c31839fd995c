#include "recon/solver/batch/batch_solver.hpp"

#include <gtest/gtest.h>

#include <random>
#include <stdexcept>

#include "recon/solver/batch/g2o_file.hpp"
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

}  // namespace
}  // namespace fathom::slam

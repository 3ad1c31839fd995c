#include <gmock/gmock.h>

#include <random>

#include "realtime/base/input_error.hpp"
#include "recon/solver/pose_graph.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::slam {
namespace {

using ::testing::AllOf, ::testing::HasSubstr;

SE3 randomPose(std::mt19937& random, double turn) {
  std::normal_distribution<double> normal;
  Vector6d twist;
  for (int i = 0; i < 6; ++i) twist(i) = (i < 3 ? 3.0 : turn) * normal(random);
  return SE3::exp(twist);
}

TEST(RelativePose, DerivativesAgreeWithDifferencesForAnyPosesAndErrors) {
  std::mt19937 random(7);
  for (int round = 0; round < 50; ++round) {
    RelativePose edge{.T_from_to = randomPose(random, 0.7)};
    const SE3 from = randomPose(random, 0.7);
    // Errors from small to large, but for half turns, where the sign of the quaternion changes.
    const SE3 to = from * edge.T_from_to * randomPose(random, 0.02 * round);
    const RelativePoseLinear l = linearize(edge, from, to);
    EXPECT_LT((l.error - relativePoseError(edge, from, to)).norm(), 1e-12);
    constexpr double kStep = 1e-6;
    for (int i = 0; i < 6; ++i) {
      const Vector6d d = kStep * Vector6d::Unit(i);
      const Vector6d by_from = (relativePoseError(edge, perturbed(from, d), to) -
                                relativePoseError(edge, perturbed(from, -d), to)) /
                               (2 * kStep);
      const Vector6d by_to = (relativePoseError(edge, from, perturbed(to, d)) -
                              relativePoseError(edge, from, perturbed(to, -d))) /
                             (2 * kStep);
      EXPECT_LT((by_from - l.by_from.col(i)).norm(), 1e-7);
      EXPECT_LT((by_to - l.by_to.col(i)).norm(), 1e-7);
    }
  }
}

TEST(RelativePose, BothSignsOfAQuaternionMeanTheSameRotation) {
  std::mt19937 random(8);
  RelativePose edge{.T_from_to = randomPose(random, 1.0)};
  const SE3 from = randomPose(random, 1.0), to = randomPose(random, 1.0);
  const Eigen::Quaterniond& q = to.rotation();
  const SE3 other(Eigen::Quaterniond(-q.w(), -q.x(), -q.y(), -q.z()), to.translation());
  EXPECT_LT((relativePoseError(edge, from, to) - relativePoseError(edge, from, other)).norm(), 1e-12);
}

const std::string kTwo =
    "# two poses\nVERTEX_SE3:QUAT 4 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 2 1 2 3 0 0 1 0\nFIX 4\n";
const std::string kInformation = " 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 .1 .2 4 .3 4";
const std::string kEdge = "EDGE_SE3:QUAT 4 2 1 0 0 0 0 0 2" + kInformation + "\n";

std::string errorOf(const std::string& text) {
  return test::refusal([&] { (void)parseG2o(text, "graph.g2o"); });
}

TEST(G2oFile, PosesComeByIdAndEdgesByIndex) {
  const PoseGraph graph = parseG2o(kTwo + kEdge, "graph.g2o");
  EXPECT_THAT(graph.ids, ::testing::ElementsAre(2, 4));
  EXPECT_EQ(graph.poses[0].translation(), Eigen::Vector3d(1, 2, 3));
  ASSERT_EQ(graph.edges.size(), 1U);
  EXPECT_EQ(graph.edges[0].from, 1);
  EXPECT_EQ(graph.edges[0].to, 0);
  EXPECT_NEAR(graph.edges[0].T_from_to.rotation().w(), 1, 1e-15);  // normalised
  EXPECT_EQ(graph.edges[0].information(3, 5), 0.2);
  EXPECT_EQ(graph.edges[0].information(5, 3), 0.2);
}

TEST(G2oFile, WhatIsWrittenIsReadBack) {
  const test::TemporaryFolder folder;
  const PoseGraph graph = parseG2o(kTwo + kEdge, "graph.g2o");
  writeG2o(folder.path() / "a.g2o", graph);
  const PoseGraph again = readG2o(folder.path() / "a.g2o");
  EXPECT_EQ(again.ids, graph.ids);
  EXPECT_NEAR(chiSquare(again), chiSquare(graph), 1e-9 * chiSquare(graph));
}

// Eigenvalues 3 and -1 in the plane of x and y, 1 and 4 elsewhere.
const std::string kIndefinite = "EDGE_SE3:QUAT 4 2 1 0 0 0 0 0 1 1 2 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4\n";

TEST(G2oFile, AnInformationThatIsNotPositiveIsRefusedByLineWithTheFix) {
  EXPECT_THAT(errorOf(kTwo + kEdge + kIndefinite),
              AllOf(HasSubstr("graph.g2o"), HasSubstr("line 6"), HasSubstr("not positive semidefinite"),
                    HasSubstr("--nearest-positive")));
  EXPECT_THAT(errorOf(kTwo + "EDGE_SE3:QUAT 4 2 1 0 0 0 0 0 1 1 1 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4"), "")
      << "semidefinite: one direction is not measured";
}

TEST(G2oFile, WhereAskedForTheNearestPositiveInformationTakesItsPlaceAndIsCounted) {
  int replaced = -1;
  const PoseGraph graph = parseG2o(kTwo + kEdge + kIndefinite + kIndefinite, "graph.g2o", &replaced);
  EXPECT_EQ(replaced, 2);
  Matrix6d expected = Vector6d(1.5, 1.5, 1, 4, 4, 4).asDiagonal();
  expected(0, 1) = expected(1, 0) = 1.5;
  EXPECT_LT((graph.edges[1].information - expected).norm(), 1e-12);
  EXPECT_EQ(graph.edges[0].information, parseG2o(kTwo + kEdge, "graph.g2o").edges[0].information);
}

TEST(G2oFile, BadLinesAreRefusedByFileAndLine) {
  EXPECT_THAT(errorOf(kTwo + "EDGE_SE3:QUAT 4 3 1 0 0 0 0 0 1" + kInformation),
              AllOf(HasSubstr("graph.g2o"), HasSubstr("line 5"), HasSubstr("pose 3")));
  EXPECT_THAT(errorOf(kTwo + "EDGE_SE3:QUAT 4 4 1 0 0 0 0 0 1" + kInformation), HasSubstr("itself"));
  EXPECT_THAT(errorOf(kTwo + "VERTEX_SE3:QUAT 4 0 0 0 0 0 0 1"), HasSubstr("second time"));
  EXPECT_THAT(errorOf("VERTEX_SE3:QUAT 1 0 0 0 0 0 0 0"), HasSubstr("length zero"));
  EXPECT_THAT(errorOf("VERTEX_SE3:QUAT 1 0 0 nan 0 0 0 1"), HasSubstr("nan"));
  EXPECT_THAT(errorOf("VERTEX_SE3:QUAT 1 0 0 0 0 0 1"), HasSubstr("ends too soon"));
  EXPECT_THAT(errorOf("VERTEX_SE3:QUAT 1 0 0 0 0 0 0 1 9"), HasSubstr("more numbers"));
  EXPECT_THAT(errorOf("VERTEX_SE2 1 0 0 0"), HasSubstr("VERTEX_SE2"));
  EXPECT_THAT(errorOf(""), HasSubstr("no VERTEX_SE3:QUAT"));
  EXPECT_THROW((void)readG2o("/absent.g2o"), InputError);
  EXPECT_THROW((void)readG2o("/tmp"), InputError);
}

}  // namespace
}  // namespace fathom::slam

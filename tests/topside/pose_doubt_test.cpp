#include "recon/topside/pieces/pose_doubt.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace fathom::topside {
namespace {

constexpr double kSurface = 0.003;  // sigma of the surface itself [m]

// Sigma of a level triangle under pair `pair` of three, when poses 0 and 2 are known to 0.1 and 0.2 m.
double sigmaUnder(std::uint32_t pair) {
  Matrix6d deep = Matrix6d::Zero(), deeper = Matrix6d::Zero();
  deep(2, 2) = 0.01, deeper(2, 2) = 0.04;
  const std::vector<SE3> level(4, SE3(Eigen::Quaterniond::Identity(), {0, 0, 18}));
  const std::vector<SlamResult::Uncertain> uncertain = {{0, level[0], deep, Matrix6d::Zero()},
                                                        {2, level[2], deeper, Matrix6d::Zero()}};
  Mesh mesh;
  mesh.vertices = {{0, 0, 20}, {0, 0.1F, 20}, {0.1F, 0, 20}};
  mesh.normals.assign(3, {0, 0, -1});
  mesh.sigma.assign(3, static_cast<float>(kSurface));
  mesh.triangles.push_back({0, 1, 2});
  const std::vector<fusion::MeshFootprint> wide(4, {{-1, -1, 1, 1}});
  addPoseVariance(PoseDoubt(uncertain).viewsOf({pair}, level, wide), mesh);
  return static_cast<double>(mesh.sigma[0]);
}

TEST(PoseDoubt, IsThatOfTheNearestPairWhoseDoubtIsKnown) {
  EXPECT_NEAR(sigmaUnder(0), std::hypot(kSurface, 0.1), 1e-6);
  EXPECT_NEAR(sigmaUnder(1), std::hypot(kSurface, 0.1), 1e-6);
  EXPECT_NEAR(sigmaUnder(3), std::hypot(kSurface, 0.2), 1e-6);
}

TEST(PoseDoubt, OfPosesThatAreGivenIsNotAdded) {
  Mesh mesh;
  mesh.vertices = {{0, 0, 20}};
  mesh.normals = {{0, 0, -1}};
  mesh.sigma = {static_cast<float>(kSurface)};
  addPoseVariance(PoseDoubt().viewsOf({0}, {SE3()}, {{{-1, -1, 1, 1}}}), mesh);
  EXPECT_EQ(mesh.sigma.front(), static_cast<float>(kSurface));
}

}  // namespace
}  // namespace fathom::topside

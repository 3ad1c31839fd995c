#include "recon/geometry/pose_variance.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "recon/geometry/uncertain_pose.hpp"

namespace fathom {
namespace {

constexpr float kSurface = 0.003F;  // sigma of the surface itself [m]

// Level ground 20 m deep, and a slope of 30 degrees, under a camera that looks down.
Mesh ground() {
  Mesh mesh;
  for (const float north : {-0.6F, 0.0F, 0.9F}) mesh.vertices.emplace_back(north, 0.4F * north, 20.0F);
  mesh.normals.assign(2, {0, 0, -1});
  mesh.normals.emplace_back(-0.5F, 0, -std::sqrt(0.75F));
  mesh.triangles.push_back({0, 1, 2});
  mesh.sigma.assign(3, kSurface);
  return mesh;
}

SE3 camera(double north) {
  return SE3::fromEuler(0.05, -0.1, 0.7, {north, 0.1, 18});
}

Matrix6d covarianceOf(std::uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Matrix6d root;
  for (int k = 0; k < 36; ++k) root(k / 6, k % 6) = (k / 6 < 3 ? 0.05 : 0.02) * normal(random);
  return root * root.transpose();
}

constexpr std::array<double, 4> kWide = {-1, -1, 1, 1};

// How far points of a mesh go along its normals, by poses drawn around the camera's.
TEST(PoseVariance, IsThatOfDrawnPoses) {
  const Matrix6d covariance = covarianceOf(5);
  const std::vector<UncertainView> views = {{camera(0), covariance, kWide}};
  Mesh mesh = ground();
  addPoseVariance(views, mesh);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const Matrix6d root = covariance.llt().matrixL();
  constexpr int kDraws = 20'000;
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  for (int k = 0; k < kDraws; ++k) {
    const SE3 moved = perturbed(camera(0), root * Vector6d::NullaryExpr([&] { return normal(random); }));
    for (std::size_t v = 0; v < 3; ++v) {
      const Eigen::Vector3d at = mesh.vertices[v].cast<double>();
      const double off = (moved * (camera(0).inverse() * at) - at).dot(mesh.normals[v].cast<double>());
      squares[static_cast<int>(v)] += off * off / kDraws;
    }
  }
  for (std::size_t v = 0; v < 3; ++v)
    EXPECT_NEAR(static_cast<double>(mesh.sigma[v]),
                std::hypot(static_cast<double>(kSurface), std::sqrt(squares[static_cast<int>(v)])),
                0.02 * static_cast<double>(mesh.sigma[v]));
}

// Passes that navigation places together do not make a place surer; those beside it have no say.
TEST(PoseVariance, IsTheMeanOverTheViewsOfThePlace) {
  Matrix6d deep = Matrix6d::Zero(), deeper = Matrix6d::Zero();
  deep(2, 2) = 0.01, deeper(2, 2) = 0.04;
  const SE3 level(Eigen::Quaterniond::Identity(), {0, 0, 18});
  const std::vector<UncertainView> views = {
      {level, deep, kWide}, {level, deep, kWide}, {level, deeper, {0.5, -1, 2, 1}}};
  Mesh mesh = ground();
  mesh.normals.back() = {0, 0, -1};
  addPoseVariance(views, mesh);
  const double own = static_cast<double>(kSurface) * static_cast<double>(kSurface);
  EXPECT_NEAR(static_cast<double>(mesh.sigma[0]), std::sqrt(own + 0.01), 1e-6);
  EXPECT_NEAR(static_cast<double>(mesh.sigma[2]), std::sqrt(own + (0.01 + 0.01 + 0.04) / 3), 1e-6);
}

TEST(PoseVariance, IsOfGroundThatAViewTakesIn) {
  Mesh mesh = ground();
  addPoseVariance({}, mesh);
  EXPECT_EQ(mesh.sigma, ground().sigma);
  const std::vector<UncertainView> views = {{camera(0), covarianceOf(5), {5, 5, 6, 6}}};
  addPoseVariance(views, mesh);
  EXPECT_EQ(mesh.sigma, ground().sigma);
}

}  // namespace
}  // namespace fathom

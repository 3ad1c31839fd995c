#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "tests/support/lattice_mesh.hpp"

namespace fathom::onboard::testing {

inline constexpr std::size_t kPoints = 400;  // of a mesh, at most

// What a camera 2 m over rolling ground gives: dense in every third mesh, sparse in every fifth, so that the
// quadtree makes large tiles and splits them.
inline Mesh meshAt(const SE3& T_nav_cam, int number) {
  const int side = number % 5 == 0 ? 6 : number % 3 == 0 ? 20 : 14;
  std::mt19937 random(static_cast<std::uint32_t>(number));
  std::uniform_real_distribution<float> jitter(-0.02F, 0.02F);
  Mesh mesh;
  for (int i = 0; i < side; ++i)
    for (int j = 0; j < side; ++j) {
      const float x = 1.4F * (static_cast<float>(i) / static_cast<float>(side - 1) - 0.5F) + jitter(random);
      const float y = 1.1F * (static_cast<float>(j) / static_cast<float>(side - 1) - 0.5F) + jitter(random);
      const Eigen::Vector3d p = T_nav_cam * Eigen::Vector3d(x, y, 2);
      mesh.vertices.emplace_back(x, y,
                                 2.0F + 0.1F * static_cast<float>(std::sin(3 * p.x()) * std::cos(2 * p.y())));
      mesh.sigma.push_back(0.01F);
      mesh.colours.push_back({static_cast<std::uint8_t>(100 + i), static_cast<std::uint8_t>(90 + j), 80});
    }
  mesh.triangles = test::latticeTriangles(side, side);
  return mesh;
}

inline SE3 odomAt(int number) {
  return SE3::fromEuler(0.02 * std::sin(number), 0.01, 0.1 * number,
                        {0.25 * (number % 20), 0.8 * (number / 20), 10});
}

inline void expectEqual(const Mesh& a, const Mesh& b) {
  ASSERT_EQ(a.vertices.size(), b.vertices.size());
  ASSERT_EQ(a.triangles, b.triangles);
  ASSERT_EQ(a.colours, b.colours);
  ASSERT_EQ(a.sigma, b.sigma);
  for (std::size_t i = 0; i < a.vertices.size(); ++i) ASSERT_EQ(a.vertices[i], b.vertices[i]);
}

}  // namespace fathom::onboard::testing

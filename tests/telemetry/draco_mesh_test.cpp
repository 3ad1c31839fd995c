#include "telemetry/tiles/draco_mesh.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/lattice_mesh.hpp"

namespace fathom::telemetry {
namespace {

Mesh dune(int side) {
  Mesh mesh;
  for (int i = 0; i < side; ++i) {
    for (int j = 0; j < side; ++j) {
      mesh.vertices.emplace_back(0.1F * static_cast<float>(i), 0.1F * static_cast<float>(j),
                                 20 + 0.2F * std::sin(0.3F * static_cast<float>(i + 2 * j)));
      mesh.colours.push_back({static_cast<std::uint8_t>(5 * i), 200, static_cast<std::uint8_t>(5 * j)});
    }
  }
  mesh.triangles = test::latticeTriangles(side, side);
  return mesh;
}

TEST(DracoMesh, KeepsEveryVertexWithinTheErrorAndTheColourOfEach) {
  const Mesh mesh = dune(20);
  for (const double error : {0.001, 0.01, 0.03}) {
    const auto bytes = encodeDracoMesh(mesh, {.max_error = error});
    ASSERT_TRUE(bytes);
    const auto got = decodeDracoMesh(*bytes);
    ASSERT_TRUE(got);
    ASSERT_EQ(got->triangles.size(), mesh.triangles.size());
    ASSERT_EQ(got->vertices.size(), mesh.vertices.size());
    ASSERT_EQ(got->colours.size(), mesh.colours.size());
    for (std::size_t k = 0; k < got->vertices.size(); ++k) {
      const Eigen::Vector3f& v = got->vertices[k];
      const auto nearest =
          static_cast<std::size_t>(std::lround(v.x() / 0.1F) * 20 + std::lround(v.y() / 0.1F));
      ASSERT_LT(nearest, mesh.vertices.size());
      EXPECT_LE((v - mesh.vertices[nearest]).cwiseAbs().maxCoeff(), static_cast<float>(error) + 1e-5F);
      EXPECT_EQ(got->colours[k], mesh.colours[nearest]);
    }
  }
}

TEST(DracoMesh, RefusesWhatItCannotSend) {
  EXPECT_FALSE(encodeDracoMesh({}, {}));
  Mesh mesh = dune(5);
  EXPECT_FALSE(encodeDracoMesh(mesh, {.max_vertices = 24}));
  EXPECT_FALSE(encodeDracoMesh(mesh, {.max_error = 0}));
  EXPECT_FALSE(encodeDracoMesh(mesh, {.max_error = 1e-10}));
  mesh.vertices[3].x() = std::nanf("");
  EXPECT_FALSE(encodeDracoMesh(mesh, {}));
  mesh = dune(5);
  mesh.triangles[0][1] = 25;
  EXPECT_FALSE(encodeDracoMesh(mesh, {}));
}

TEST(DracoMesh, SurvivesTruncationDamageAndCountsThatAreTooLarge) {
  const auto bytes = encodeDracoMesh(dune(12), {});
  ASSERT_TRUE(bytes);
  EXPECT_FALSE(decodeDracoMesh(*bytes, 143));
  for (std::size_t n = 0; n < bytes->size(); ++n) (void)decodeDracoMesh(std::span(*bytes).first(n));
  std::mt19937 random(5);
  for (int k = 0; k < 2000; ++k) {
    auto damaged = *bytes;
    for (int hits = 0; hits < 3; ++hits)
      damaged[random() % damaged.size()] = static_cast<std::uint8_t>(random());
    const auto got = decodeDracoMesh(damaged, 1000);
    if (!got) continue;
    EXPECT_LE(got->vertices.size(), 4000U);
    for (const auto& triangle : got->triangles)
      for (const std::uint32_t v : triangle) EXPECT_LT(v, got->vertices.size());
  }
}

}  // namespace
}  // namespace fathom::telemetry

#include "recon/geometry/height_tile.hpp"

#include <gtest/gtest.h>

namespace fathom {
namespace {

HeightTile flatTile() {
  HeightTile tile;
  tile.size = 4.0;
  tile.north_index = -1;
  for (auto& node : tile.nodes) {
    node.coverage = 1;
    node.depth = 12;
  }
  return tile;
}

TEST(HeightTile, AFullTileGivesTwoTrianglesACellFacingUp) {
  Mesh mesh;
  appendTile(mesh, flatTile());
  EXPECT_EQ(mesh.vertices.size(), static_cast<std::size_t>(HeightTile::kNodes));
  EXPECT_EQ(mesh.triangles.size(), 2u * HeightTile::kCells * HeightTile::kCells);
  EXPECT_FLOAT_EQ(mesh.vertices.front().x(), -4.0f);
  EXPECT_FLOAT_EQ(mesh.vertices.back().x(), 0.0f);
  computeNormals(mesh);
  for (const auto& n : mesh.normals) EXPECT_FLOAT_EQ(n.z(), -1.0f);
}

TEST(HeightTile, AnUnseenNodeTakesOneTriangleFromEachCellAroundIt) {
  HeightTile tile = flatTile();
  tile.at(5, 5).coverage = 0;
  Mesh mesh;
  appendTile(mesh, tile);
  EXPECT_EQ(mesh.vertices.size(), static_cast<std::size_t>(HeightTile::kNodes) - 1);
  EXPECT_EQ(mesh.triangles.size(), 2u * HeightTile::kCells * HeightTile::kCells - 4u);
  computeNormals(mesh);
  for (const auto& n : mesh.normals) EXPECT_FLOAT_EQ(n.z(), -1.0f);
}

TEST(HeightTile, AnEmptyTileAddsNothing) {
  Mesh mesh;
  appendTile(mesh, HeightTile{});
  EXPECT_TRUE(mesh.vertices.empty());
  EXPECT_TRUE(mesh.empty());
}

}  // namespace
}  // namespace fathom

#include "recon/geometry/height_tile.hpp"

namespace fathom {

void appendTile(Mesh& mesh, const HeightTile& tile) {
  constexpr std::uint32_t kUnseen = 0xFFFFFFFF;
  std::array<std::uint32_t, HeightTile::kNodes> index;
  index.fill(kUnseen);
  for (int i = 0; i < HeightTile::kSide; ++i) {
    for (int j = 0; j < HeightTile::kSide; ++j) {
      const HeightTile::Node& node = tile.at(i, j);
      if (node.coverage <= 0) continue;
      index[static_cast<std::size_t>(i * HeightTile::kSide + j)] =
          static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.emplace_back(static_cast<float>(tile.north0() + i * tile.spacing()),
                                 static_cast<float>(tile.east0() + j * tile.spacing()), node.depth);
      mesh.colours.push_back(node.colour);
      mesh.sigma.push_back(node.sigma);
    }
  }
  const auto triangle = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (a != kUnseen && b != kUnseen && c != kUnseen) mesh.triangles.push_back({a, b, c});
  };
  for (int i = 0; i < HeightTile::kCells; ++i) {
    for (int j = 0; j < HeightTile::kCells; ++j) {
      const auto at = [&](int di, int dj) {
        return index[static_cast<std::size_t>((i + di) * HeightTile::kSide + j + dj)];
      };
      const std::uint32_t sw = at(0, 0), nw = at(1, 0), se = at(0, 1), ne = at(1, 1);
      // Counter-clockwise seen from above (from negative z, where north x east points down).
      if (sw != kUnseen && ne != kUnseen) {
        triangle(sw, se, ne);
        triangle(sw, ne, nw);
      } else {
        triangle(sw, se, nw);
        triangle(se, ne, nw);
      }
    }
  }
}

}  // namespace fathom

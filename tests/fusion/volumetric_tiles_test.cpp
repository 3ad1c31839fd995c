#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <set>
#include <stdexcept>

#include "recon/fusion/volumetric_fusion.hpp"
#include "tests/world/ground.hpp"

namespace fathom::fusion {
namespace {

using test::rangeMesh;
using Place = std::array<float, 3>;
using Segment = std::pair<Place, Place>;

constexpr double kTile = 64 * 0.033;  // [m]

// Steep enough that the surface meets the tiles' borders at many heights.
double tileReef(double n, double e) {
  return 2.0 + 0.25 * std::sin(2.1 * n) * std::cos(1.7 * e) + 0.06 * std::sin(9 * n + 4 * e);
}

struct Scan {
  Mesh mesh;
  Eigen::Vector3d centre;
};

// Overlapping footprints over an area of some 3 x 2 tiles about the origin, with a fish in one of them.
std::vector<Scan> survey() {
  std::vector<Scan> scans;
  unsigned seed = 0;
  for (double e = -2.4; e <= 2.4; e += 0.8) {
    for (double n = -3.2; n <= 3.2; n += 0.4) {
      const bool fish = ++seed % 17 == 0;
      const auto depth = [&](double x, double y) {
        return fish && std::hypot(x - n, y - e) < 0.15 ? 1.2 : tileReef(x, y);
      };
      scans.push_back({rangeMesh({.north = n,
                                  .east = e,
                                  .length = 1.2,
                                  .width = 1.5,
                                  .sigma = 0.006,
                                  .colour = {static_cast<std::uint8_t>(seed), 120, 60}},
                                 depth, seed),
                       Eigen::Vector3d(n, e, 0)});
    }
  }
  return scans;
}

// The tiles of a range, from the scans that reach into it or its overlap, as a piece is made.
std::vector<TileMesh> build(const std::vector<Scan>& scans, const std::optional<TileRange>& core) {
  VolumetricConfig config;
  const TileGrid grid;
  if (core) config.bounds = {grid, *core};
  VolumetricFusion fusion(config);
  for (const Scan& scan : scans) {
    if (core) {
      const double overlap = config.overlap;
      Eigen::Array2f low = Eigen::Array2f::Constant(INFINITY), high = -low;
      for (const auto& v : scan.mesh.vertices) {
        low = low.min(v.head<2>().array());
        high = high.max(v.head<2>().array());
      }
      if (high.x() < core->x0 * kTile - overlap || low.x() > core->x1 * kTile + overlap ||
          high.y() < core->y0 * kTile - overlap || low.y() > core->y1 * kTile + overlap)
        continue;
    }
    fusion.integrate(scan.mesh, scan.centre);
  }
  return fusion.extractTiles(grid);
}

template <typename T>
bool sameBytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

Place placeOf(const TileMesh& tile, std::uint32_t v) {
  const Eigen::Vector3f& p = tile.mesh.vertices[v];
  return {p.x(), p.y(), p.z()};
}

// Directed edges that have no opposite within the tile.
std::vector<Segment> borderOf(const TileMesh& tile, std::uint8_t side) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const auto& t : tile.mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++uses[{t[k], t[(k + 1) % 3]}];
  std::vector<Segment> out;
  for (const auto& [edge, count] : uses) {
    EXPECT_EQ(count, 1);
    if (uses.count({edge.second, edge.first}) == 0 && (tile.shared[edge.first] & side) != 0 &&
        (tile.shared[edge.second] & side) != 0)
      out.emplace_back(placeOf(tile, edge.first), placeOf(tile, edge.second));
  }
  return out;
}

class Tiles : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    scans_ = survey();
    whole_ = build(scans_, std::nullopt);
  }
  static const TileMesh* find(const TileId& id) {
    const auto found =
        std::find_if(whole_.begin(), whole_.end(), [&](const TileMesh& t) { return t.tile == id; });
    return found == whole_.end() ? nullptr : &*found;
  }
  static inline std::vector<Scan> scans_;
  static inline std::vector<TileMesh> whole_;
};

TEST_F(Tiles, PiecesBuiltApartAreTheSameBytesAsTheWholeBuiltAtOnce) {
  std::size_t compared = 0;
  for (const TileRange& core : {TileRange{-2, -2, 0, 2}, TileRange{0, -2, 2, 0}, TileRange{0, 0, 2, 2}}) {
    for (const TileMesh& tile : build(scans_, core)) {
      ASSERT_TRUE(core.contains(tile.tile));
      const TileMesh* same = find(tile.tile);
      ASSERT_NE(same, nullptr);
      EXPECT_TRUE(sameBytes(tile.mesh.vertices, same->mesh.vertices));
      EXPECT_TRUE(sameBytes(tile.mesh.normals, same->mesh.normals));
      EXPECT_TRUE(sameBytes(tile.mesh.sigma, same->mesh.sigma));
      EXPECT_EQ(tile.mesh.colours, same->mesh.colours);
      EXPECT_EQ(tile.mesh.triangles, same->mesh.triangles);
      EXPECT_EQ(tile.shared, same->shared);
      EXPECT_EQ(tile.views, same->views);
      ++compared;
    }
  }
  EXPECT_EQ(compared, whole_.size());
  EXPECT_GE(compared, 14U);
}

TEST_F(Tiles, EveryBorderEdgeOfATileOccursOnceInItsNeighbour) {
  std::size_t edges = 0;
  for (const TileMesh& tile : whole_) {
    const auto check = [&](TileId to, std::uint8_t side, std::uint8_t other_side) {
      const TileMesh* neighbour = find(to);
      if (neighbour == nullptr) return;
      std::vector<Segment> own = borderOf(tile, side), other = borderOf(*neighbour, other_side);
      for (Segment& s : other) std::swap(s.first, s.second);
      std::sort(own.begin(), own.end());
      std::sort(other.begin(), other.end());
      // The survey's outline may cross a tile's border, where an edge has no neighbour.
      std::vector<Segment> alone;
      std::set_symmetric_difference(own.begin(), own.end(), other.begin(), other.end(),
                                    std::back_inserter(alone));
      EXPECT_LE(alone.size(), 2U);
      edges += own.size();
    };
    check({0, tile.tile.x + 1, tile.tile.y}, kHighNorth, kLowNorth);
    check({0, tile.tile.x, tile.tile.y + 1}, kHighEast, kLowEast);
  }
  EXPECT_GT(edges, 900U);
}

TEST_F(Tiles, SharedVerticesAgreeInPositionNormalAndColour) {
  std::map<Place, std::pair<Eigen::Vector3f, Rgb>> seen;
  std::size_t met_again = 0;
  for (const TileMesh& tile : whole_) {
    for (std::uint32_t v = 0; v < tile.mesh.vertices.size(); ++v) {
      const std::pair<Eigen::Vector3f, Rgb> what{tile.mesh.normals[v], tile.mesh.colours[v]};
      const auto [at, is_new] = seen.try_emplace(placeOf(tile, v), what);
      if (is_new) continue;
      ++met_again;
      EXPECT_NE(tile.shared[v], 0);
      EXPECT_EQ(at->second, what);
    }
  }
  EXPECT_GT(met_again, 900U);
}

TEST_F(Tiles, VerticesAreOnTheLatticeAndNoTriangleIsDegenerate) {
  const TileGrid grid;
  for (const TileMesh& tile : whole_) {
    const auto box = grid.box(tile.tile);
    std::set<Place> places;
    for (std::uint32_t v = 0; v < tile.mesh.vertices.size(); ++v) {
      for (const float x : placeOf(tile, v)) EXPECT_EQ(static_cast<double>(x), TileGrid::snap(x));
      EXPECT_TRUE(places.insert(placeOf(tile, v)).second);
      const double n = tile.mesh.vertices[v].x(), e = tile.mesh.vertices[v].y();
      EXPECT_GE(n, TileGrid::snap(box[0]));
      EXPECT_LE(n, TileGrid::snap(box[2]));
      if ((tile.shared[v] & kLowNorth) != 0) {
        EXPECT_EQ(n, TileGrid::snap(box[0]));
      }
      if ((tile.shared[v] & kHighNorth) != 0) {
        EXPECT_EQ(n, TileGrid::snap(box[2]));
      }
      if ((tile.shared[v] & kLowEast) != 0) {
        EXPECT_EQ(e, TileGrid::snap(box[1]));
      }
      if ((tile.shared[v] & kHighEast) != 0) {
        EXPECT_EQ(e, TileGrid::snap(box[3]));
      }
      EXPECT_NEAR(tile.mesh.normals[v].norm(), 1.0F, 1e-5F);
      EXPECT_GE(tile.views[v], 1);
    }
    for (const auto& [a, b, c] : tile.mesh.triangles) {
      const Eigen::Vector3d p = tile.mesh.vertices[a].cast<double>();
      EXPECT_GT(
          (tile.mesh.vertices[b].cast<double>() - p).cross(tile.mesh.vertices[c].cast<double>() - p).norm(),
          0.0);
    }
  }
}

TEST_F(Tiles, TheSurfaceIsThatOfTheSeafloor) {
  double sum = 0;
  std::size_t count = 0;
  for (const TileMesh& tile : whole_) {
    for (const auto& v : tile.mesh.vertices) {
      if (std::abs(v.x()) > 3 || std::abs(v.y()) > 2.4) continue;
      const double error = static_cast<double>(v.z()) - tileReef(v.x(), v.y());
      sum += error * error;
      ++count;
    }
  }
  EXPECT_GT(count, 10000U);
  EXPECT_LT(std::sqrt(sum / static_cast<double>(count)), 0.008);
}

TEST(TileParts, ASmallLoosePartIsLeftOutAndALargeOneKept) {
  const auto plate = [](double size) {
    return rangeMesh(
        {.north = 1, .east = 1, .length = size, .width = size, .sigma = 0.005},
        [](double, double) { return 2.0; }, 1);
  };
  VolumetricConfig config;
  for (const auto& [size, kept] : {std::pair{0.18, false}, std::pair{0.5, true}}) {
    VolumetricFusion fusion(config);
    fusion.integrate(plate(size), Eigen::Vector3d(1, 1, 0));
    EXPECT_FALSE(fusion.extract().empty());
    EXPECT_EQ(!fusion.extractTiles(TileGrid{}).empty(), kept);
  }
}

TEST(TileParts, LongThinPartsAreKept) {
  // Little area, but longer than half the overlap: a piece with one end does not have the other.
  VolumetricFusion fusion({});
  fusion.integrate(rangeMesh(
                       {.north = 0, .east = 1, .length = 2, .width = 0.1, .sigma = 0.005},
                       [](double, double) { return 2.0; }, 1),
                   Eigen::Vector3d(0, 1, 0));
  EXPECT_FALSE(fusion.extractTiles(TileGrid{}).empty());
}

TEST(TileParts, TheHaloGivesTheNeighboursToo) {
  VolumetricFusion fusion({.bounds = FusionBounds{TileGrid{}, {0, 0, 1, 1}}});
  fusion.integrate(rangeMesh({.north = 1, .east = 2, .length = 2, .width = 2}, tileReef, 1),
                   Eigen::Vector3d(1, 2, 0));
  EXPECT_EQ(fusion.extractTiles(TileGrid{}).size(), 1U);
  EXPECT_EQ(fusion.extractTiles(TileGrid{}, 1).size(), 2U);
}

TEST(TileParts, AGridThatDoesNotFitIsRefused) {
  VolumetricFusion fusion({});
  EXPECT_THROW((void)fusion.extractTiles(TileGrid{.voxel = 0.02}), std::invalid_argument);
  EXPECT_THROW((void)fusion.extractTiles(TileGrid{.leaf_voxels = 20}), std::invalid_argument);
  VolumetricConfig config;
  config.bounds = {TileGrid{.voxel = 0.02}, {0, 0, 1, 1}};
  EXPECT_THROW(VolumetricFusion{config}, std::invalid_argument);
  config.bounds = {TileGrid{}, {0, 0, 0, 1}};
  EXPECT_THROW(VolumetricFusion{config}, std::invalid_argument);
  config.bounds = {TileGrid{}, {0, 0, 1, 1}};
  config.overlap = 0.4;
  EXPECT_THROW(VolumetricFusion{config}, std::invalid_argument);
}

}  // namespace
}  // namespace fathom::fusion

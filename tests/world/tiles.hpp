#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <vector>

#include "recon/fusion/marching_cubes.hpp"
#include "recon/geometry/tile_mesh.hpp"
#include "recon/surface/simplify.hpp"
#include "tests/support/lattice_mesh.hpp"

namespace fathom::test {

// Signed distance [m], negative inside the ground, at a place in nav; NaN where nothing was observed.
using Ground = std::function<double(double north, double east, double depth)>;

// Noise from a lattice of random values, smooth in between: the same at any place for every tile.
inline double smoothNoise(double north, double east, double step, unsigned seed) {
  const auto value = [&](double i, double j) {
    std::uint64_t h = seed * 0x9E3779B97F4A7C15ULL +
                      static_cast<std::uint64_t>(static_cast<std::int64_t>(i)) * 0xBF58476D1CE4E5B9ULL +
                      static_cast<std::uint64_t>(static_cast<std::int64_t>(j)) * 0x94D049BB133111EBULL;
    h = (h ^ (h >> 31)) * 0xD6E8FEB86659FD93ULL;
    h ^= h >> 32;
    return static_cast<double>(h % 2000001) / 1e6 - 1;
  };
  const double x = north / step, y = east / step;
  const double i = std::floor(x), j = std::floor(y);
  const auto ease = [](double t) { return t * t * (3 - 2 * t); };
  const double u = ease(x - i), v = ease(y - j);
  return (1 - u) * ((1 - v) * value(i, j) + v * value(i, j + 1)) +
         u * ((1 - v) * value(i + 1, j) + v * value(i + 1, j + 1));
}

inline double terrainDepth(double north, double east, double noise, unsigned seed) {
  return 2.0 + 0.1 * std::sin(1.7 * north) + 0.08 * std::cos(2.3 * east) +
         noise * smoothNoise(north, east, 0.1, seed) + 3 * noise * smoothNoise(north, east, 0.6, seed + 1);
}

// Rolling seafloor at 2 m with noise, as fused stereo leaves it: smooth over about three voxels.
[[nodiscard]] inline Ground noisyTerrain(double noise, unsigned seed) {
  return [=](double north, double east, double depth) {
    return 0.9 * (terrainDepth(north, east, noise, seed) - depth);
  };
}

// The same with a boulder that overhangs, a free-standing wall 8 cm thick, a hole in the data, an arch and a
// pebble that touches nothing.
[[nodiscard]] inline Ground difficultTerrain(unsigned seed) {
  return [=](double north, double east, double depth) {
    if (std::hypot(north - 1.5, east - 0.6) < 0.25) return std::numeric_limits<double>::quiet_NaN();
    const double floor = 0.9 * (terrainDepth(north, east, 0.006, seed) - depth);
    const auto sphere = [&](double n, double e, double d, double r) {
      return std::sqrt((north - n) * (north - n) + (east - e) * (east - e) + (depth - d) * (depth - d)) - r;
    };
    const double boulder = sphere(0.6, 0.6, 1.75, 0.32);
    const double wall = std::max({std::abs(east - 1.55) - 0.04, std::abs(north - 1.2) - 0.7, 1.4 - depth});
    const double ring = std::hypot(north - 0.7, depth - 1.95) - 0.35;
    const double arch = std::hypot(ring, east - 2.1) - 0.09;
    const double pebble = sphere(1.7, 1.1, 1.2, 0.06);
    return std::min({floor, boulder, wall, arch, pebble}) +
           0.004 * smoothNoise(north + depth, east - depth, 0.09, seed);
  };
}

// The surface of `ground` within a leaf tile, between two depths: marching cubes over the cells that the tile
// owns, vertices on the lattice, those on its sides shared.
[[nodiscard]] inline TileMesh syntheticTile(const Ground& ground, const TileGrid& grid, const TileId& tile,
                                            double top = 0.5, double bottom = 3.0) {
  static const fusion::MarchingCubesTable table;
  const int n = grid.leaf_voxels + 1;
  const int base = static_cast<int>(std::floor(top / grid.voxel));
  const int layers = static_cast<int>(std::ceil((bottom - top) / grid.voxel)) + 1;
  const auto place = [&](int i, int j, int k) {
    return Eigen::Vector3d((tile.x * grid.leaf_voxels + i) * grid.voxel,
                           (tile.y * grid.leaf_voxels + j) * grid.voxel, (base + k) * grid.voxel);
  };
  const auto number = [&](int i, int j, int k) { return static_cast<std::size_t>((k * n + j) * n + i); };
  std::vector<double> distance(static_cast<std::size_t>(n * n * layers));
  for (int k = 0; k < layers; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const Eigen::Vector3d p = place(i, j, k);
        distance[number(i, j, k)] = ground(p.x(), p.y(), p.z());
      }
  TileMesh out;
  out.tile = tile;
  std::map<std::pair<std::size_t, int>, std::uint32_t> vertices;
  for (int k = 0; k + 1 < layers; ++k)
    for (int j = 0; j + 1 < n; ++j)
      for (int i = 0; i + 1 < n; ++i) {
        unsigned signs = 0;
        bool known = true;
        for (int c = 0; c < 8; ++c) {
          const double d = distance[number(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1))];
          known = known && !std::isnan(d);
          if (d < 0) signs |= 1U << c;
        }
        if (!known) continue;
        const auto& pattern = table.pattern(signs);
        for (std::size_t t = 0; t < pattern.triangles; ++t) {
          std::array<std::uint32_t, 3> triangle;
          for (std::size_t m = 0; m < 3; ++m) {
            const auto& edge = table.edge(pattern.edge[t][m]);
            const int a = i + (edge.from & 1), b = j + (edge.from >> 1 & 1), c = k + (edge.from >> 2 & 1);
            const auto [found, fresh] = vertices.try_emplace(
                {number(a, b, c), edge.axis}, static_cast<std::uint32_t>(out.mesh.vertices.size()));
            triangle[m] = found->second;
            if (!fresh) continue;
            const double from = distance[number(a, b, c)];
            const double to =
                distance[number(a + (edge.axis == 0), b + (edge.axis == 1), c + (edge.axis == 2))];
            Eigen::Vector3d p = place(a, b, c);
            p[edge.axis] += grid.voxel * std::clamp(from / (from - to), 0.05, 0.95);
            for (int x = 0; x < 3; ++x) p[x] = TileGrid::snap(p[x]);
            out.mesh.vertices.push_back(p.cast<float>());
            const bool on_north = edge.axis != 0 && (a == 0 || a == n - 1);
            const bool on_east = edge.axis != 1 && (b == 0 || b == n - 1);
            out.shared.push_back(on_north || on_east ? surface::sidesOf(out.mesh.vertices.back(), grid, tile)
                                                     : 0);
            out.mesh.sigma.push_back(0.004F);
            out.mesh.colours.push_back({static_cast<std::uint8_t>(40 + (a * 3) % 200), 120, 90});
            out.views.push_back(5);
          }
          out.mesh.triangles.push_back(triangle);
        }
      }
  computeNormals(out.mesh);
  return out;
}

using Depth = std::function<double(double north, double east)>;

// A leaf tile over a height field, triangulated every `step` [m]; border vertices on the tiles' common
// planes, as fusion's tiles have them. Colours: red by north, green by east, in steps of 1 cm.
inline TexturedTile fieldTile(const TileId& id, const TileGrid& grid, double step, const Depth& depth) {
  TexturedTile out;
  TileMesh& tile = out.surface;
  tile.tile = id;
  const auto box = grid.box(id);
  const int n = static_cast<int>(std::lround(grid.edge(0) / step));
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      const double north = TileGrid::snap(box[0] + (box[2] - box[0]) * i / n);
      const double east = TileGrid::snap(box[1] + (box[3] - box[1]) * j / n);
      tile.mesh.vertices.emplace_back(north, east, TileGrid::snap(depth(north, east)));
      const auto step_of = [](double v) {
        return static_cast<std::uint8_t>(static_cast<int>(std::floor(v * 100)) & 0xFF);
      };
      tile.mesh.colours.push_back({step_of(north), step_of(east), 7});
      tile.mesh.sigma.push_back(0.004F);
      tile.views.push_back(static_cast<std::uint16_t>(3));
    }
  }
  tile.mesh.triangles = latticeTriangles(n + 1, n + 1);
  return out;
}

// A seafloor of hills on which tiles of any level can be cut without cracks: borders keep the finest level's
// vertices, as simplification does, and inside every level has kCells x kCells squares.
struct SyntheticModel {
  static constexpr int kCells = 16;  // along a tile's edge
  TileGrid grid{0.033, 64};
  int texels = 64;  // along an atlas's edge; 0: colours at vertices

  // Height field [m, down] and colour at a place of nav; smooth, of several scales.
  [[nodiscard]] static double depth(double north, double east);
  [[nodiscard]] static Rgb colour(double north, double east);

  [[nodiscard]] TexturedTile tile(const TileId& id) const;
  // All tiles of `levels` levels below the root tile (levels - 1, 0, 0).
  [[nodiscard]] std::vector<TileId> pyramid(int levels) const;
};

using Steps = std::pair<std::int32_t, std::int32_t>;  // north and east, in the finest level's squares

// Builds one tile: vertices by their place in steps, each once.
class Builder {
 public:
  Builder(const SyntheticModel& model, const TileId& id) : model_(model) {
    stride_ = 1 << (2 * id.level);
    n0_ = id.x * stride_ * SyntheticModel::kCells;
    e0_ = id.y * stride_ * SyntheticModel::kCells;
    size_ = stride_ * SyntheticModel::kCells;
    surface_.tile = id;
    surface_.error = id.level == 0 ? 0 : 0.01 * stride_;
  }

  TileMesh build() {
    for (int i = 1; i + 1 < SyntheticModel::kCells; ++i)
      for (int j = 1; j + 1 < SyntheticModel::kCells; ++j) {
        const auto at = [&](int di, int dj) {
          return vertex({n0_ + (i + di) * stride_, e0_ + (j + dj) * stride_});
        };
        triangle(at(0, 0), at(0, 1), at(1, 0));
        triangle(at(1, 1), at(1, 0), at(0, 1));
      }
    // Between the border and the squares inside it, one side after the other, all seen from inside with the
    // border on the right.
    const int last = size_ - stride_;
    side([&](int along, int in) { return Steps{n0_ + in, e0_ + along}; }, last);
    side([&](int along, int in) { return Steps{n0_ + along, e0_ + size_ - in}; }, last);
    side([&](int along, int in) { return Steps{n0_ + size_ - in, e0_ + size_ - along}; }, last);
    side([&](int along, int in) { return Steps{n0_ + size_ - along, e0_ + in}; }, last);
    computeNormals(surface_.mesh);
    return std::move(surface_);
  }

 private:
  template <typename Place>
  void side(const Place& place, int last) {
    int outer = 0, inner = stride_;
    while (outer < size_ || inner < last) {
      const bool move_outer = inner >= last || (outer < size_ && outer + 1 <= inner);
      const std::uint32_t a = vertex(place(outer, 0)), b = vertex(place(inner, stride_));
      if (move_outer) {
        triangle(a, vertex(place(++outer, 0)), b);
      } else {
        inner += stride_;
        triangle(a, vertex(place(inner, stride_)), b);
      }
    }
  }

  std::uint32_t vertex(const Steps& at) {
    const auto found = std::lower_bound(known_.begin(), known_.end(), at,
                                        [](const auto& pair, const Steps& key) { return pair.first < key; });
    if (found != known_.end() && found->first == at) return found->second;
    const auto number = static_cast<std::uint32_t>(surface_.mesh.vertices.size());
    known_.insert(found, {at, number});
    const double step = model_.grid.edge(0) / SyntheticModel::kCells;
    const double north = TileGrid::snap(at.first * step), east = TileGrid::snap(at.second * step);
    const double depth = TileGrid::snap(SyntheticModel::depth(north, east));
    surface_.mesh.vertices.emplace_back(Eigen::Vector3d(north, east, depth).cast<float>());
    surface_.shared.push_back(static_cast<std::uint8_t>(
        (at.first == n0_ ? kLowNorth : 0) | (at.first == n0_ + size_ ? kHighNorth : 0) |
        (at.second == e0_ ? kLowEast : 0) | (at.second == e0_ + size_ ? kHighEast : 0)));
    surface_.views.push_back(static_cast<std::uint16_t>(3 + number % 5));
    surface_.mesh.sigma.push_back(0.002F + 0.001F * static_cast<float>(std::sin(3 * north)));
    return number;
  }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    surface_.mesh.triangles.push_back({a, b, c});
  }

  const SyntheticModel& model_;
  TileMesh surface_;
  std::vector<std::pair<Steps, std::uint32_t>> known_;  // ascending
  int stride_ = 1, size_ = 0;
  std::int32_t n0_ = 0, e0_ = 0;
};

inline double SyntheticModel::depth(double north, double east) {
  return 20 + 1.5 * std::sin(0.11 * north + 0.3) * std::cos(0.09 * east) +
         0.25 * std::sin(0.9 * north + 0.7 * east) + 0.05 * std::sin(5.1 * north) * std::sin(4.3 * east);
}

inline Rgb SyntheticModel::colour(double north, double east) {
  const double coarse = std::sin(0.8 * north) * std::sin(0.6 * east),
               fine = std::sin(31 * north + 9 * east) * std::sin(27 * east - 11 * north);
  const auto channel = [](double v) { return static_cast<std::uint8_t>(std::clamp(v, 0.0, 255.0)); };
  return {channel(130 + 60 * coarse + 25 * fine), channel(120 + 25 * coarse - 30 * fine),
          channel(90 - 50 * coarse + 15 * fine)};
}

inline TexturedTile SyntheticModel::tile(const TileId& id) const {
  TexturedTile made{Builder(*this, id).build(), {}, 0};
  Mesh& mesh = made.surface.mesh;
  const std::array<double, 4> box = grid.box(id);
  const double edge = grid.edge(id.level);
  if (texels == 0) {
    for (const Eigen::Vector3f& v : mesh.vertices)
      mesh.colours.push_back(colour(static_cast<double>(v.x()), static_cast<double>(v.y())));
    return made;
  }
  made.texel = edge / texels;
  made.atlas = {texels, texels, {}};
  made.atlas.rgb.resize(3 * static_cast<std::size_t>(texels) * static_cast<std::size_t>(texels));
  for (int row = 0; row < texels; ++row)
    for (int column = 0; column < texels; ++column) {
      const Rgb rgb = colour(box[2] - (row + 0.5) * made.texel, box[1] + (column + 0.5) * made.texel);
      std::copy(rgb.begin(), rgb.end(), made.atlas.at(column, row));
    }
  for (const Eigen::Vector3f& v : mesh.vertices)
    mesh.texture_coordinates.emplace_back(std::clamp((static_cast<double>(v.y()) - box[1]) / edge, 0.0, 1.0),
                                          std::clamp((static_cast<double>(v.x()) - box[0]) / edge, 0.0, 1.0));
  return made;
}

inline std::vector<TileId> SyntheticModel::pyramid(int levels) const {
  std::vector<TileId> tiles;
  for (int level = levels - 1; level >= 0; --level) {
    const int along = 1 << (2 * (levels - 1 - level));
    for (int x = 0; x < along; ++x)
      for (int y = 0; y < along; ++y) tiles.push_back({level, x, y});
  }
  return tiles;
}

}  // namespace fathom::test

#include "tests/tiles/synthetic_model.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::topside::synthetic {
namespace {

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

}  // namespace

double SyntheticModel::depth(double north, double east) {
  return 20 + 1.5 * std::sin(0.11 * north + 0.3) * std::cos(0.09 * east) +
         0.25 * std::sin(0.9 * north + 0.7 * east) + 0.05 * std::sin(5.1 * north) * std::sin(4.3 * east);
}

Rgb SyntheticModel::colour(double north, double east) {
  const double coarse = std::sin(0.8 * north) * std::sin(0.6 * east),
               fine = std::sin(31 * north + 9 * east) * std::sin(27 * east - 11 * north);
  const auto channel = [](double v) { return static_cast<std::uint8_t>(std::clamp(v, 0.0, 255.0)); };
  return {channel(130 + 60 * coarse + 25 * fine), channel(120 + 25 * coarse - 30 * fine),
          channel(90 - 50 * coarse + 15 * fine)};
}

TexturedTile SyntheticModel::tile(const TileId& id) const {
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

std::vector<TileId> SyntheticModel::pyramid(int levels) const {
  std::vector<TileId> tiles;
  for (int level = levels - 1; level >= 0; --level) {
    const int along = 1 << (2 * (levels - 1 - level));
    for (int x = 0; x < along; ++x)
      for (int y = 0; y < along; ++y) tiles.push_back({level, x, y});
  }
  return tiles;
}

}  // namespace fathom::topside::synthetic

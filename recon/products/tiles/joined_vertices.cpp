#include "recon/products/tiles/joined_vertices.hpp"

#include <bit>

namespace fathom::topside {

std::size_t JoinedVertices::Hash::operator()(const Place& place) const {
  std::uint64_t hash = 0;
  for (const float v : place) hash = hash64(hash, std::bit_cast<std::uint32_t>(v));
  return hash;
}

JoinedVertices::Numbers JoinedVertices::add(const TileMesh& tile) {
  if (tile.tile.x != x_) {
    last_row_.clear();
    if (tile.tile.x == x_ + 1) last_row_.swap(next_row_);
    next_row_.clear();
    row_.clear();
    x_ = tile.tile.x;
  }
  Numbers numbers;
  Known inside;
  const auto& vertices = tile.mesh.vertices;
  numbers.of_vertex.reserve(vertices.size());
  inside.reserve(vertices.size());
  for (std::uint32_t k = 0; k < vertices.size(); ++k) {
    // Adding zero makes -0 and 0 the same place.
    const Place place{vertices[k].x() + 0.0F, vertices[k].y() + 0.0F, vertices[k].z() + 0.0F};
    const std::uint8_t shared = tile.shared[k];
    const auto known = [&](const Known& among) {
      const auto found = among.find(place);
      return found == among.end() ? count_ : found->second;
    };
    std::uint64_t number = known(inside);
    if (number == count_ && (shared & kLowNorth) != 0) number = known(last_row_);
    if (number == count_ && (shared & (kLowEast | kLowNorth)) != 0) number = known(row_);
    if (number == count_) {
      numbers.added.push_back(k);
      ++count_;
    }
    inside.emplace(place, number);
    if (shared != 0) row_.emplace(place, number);
    if ((shared & kHighNorth) != 0) next_row_.emplace(place, number);
    numbers.of_vertex.push_back(number);
  }
  return numbers;
}

}  // namespace fathom::topside

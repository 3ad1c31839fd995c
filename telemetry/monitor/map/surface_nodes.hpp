#pragma once

#include <array>
#include <bit>
#include <optional>

#include "telemetry/monitor/map/surface.hpp"

namespace fathom::monitor {

// A node of the lattice of spacing `code`, in units; the position is a multiple of the spacing.
struct Place {
  Unit north = 0, east = 0;
};

// Reads nodes and cells of a chunk and its eight neighbours, and none beyond them.
class SurfaceNodes {
 public:
  SurfaceNodes(const BlockStore& store, ChunkKey centre);

  // The node as received at exactly this spacing.
  [[nodiscard]] std::optional<MapSurfacePoint> received(int code, Place p) const;
  [[nodiscard]] bool isReceived(int code, Place p) const;
  // Number of received corners of the cell of this spacing with its south-west corner at `p`.
  [[nodiscard]] int corners(int code, Place p) const;
  // The map at a place: the finest node received there, else between the corners of the finest whole cell
  // that touches it. Depends on the place and the store alone.
  [[nodiscard]] std::optional<MapSurfacePoint> at(Place p) const;

  [[nodiscard]] bool hasLevel(int code) const { return has_level_[static_cast<std::size_t>(code)]; }

 private:
  [[nodiscard]] const StoredBlock* blockAt(int code, Place p) const;
  [[nodiscard]] std::optional<MapSurfacePoint> finest(Place p) const;

  ChunkKey centre_;
  std::array<const BlockStore::Chunk*, 9> around_{};  // row by row from the south-west
  std::array<bool, kLevels> has_level_{};
};

// Bilinear interpolation between four corners (south-west, south-east, north-east, north-west); n and e from
// 0 to 1.
[[nodiscard]] MapSurfacePoint between(const std::array<MapSurfacePoint, 4>& corners, double n, double e);

}  // namespace fathom::monitor

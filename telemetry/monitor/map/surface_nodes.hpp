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

// Reads nodes and cells of a chunk and its eight neighbours (cells and nodes beyond them do not exist here).
class SurfaceNodes {
 public:
  SurfaceNodes(const BlockStore& store, ChunkKey centre);

  // As received at exactly this spacing.
  [[nodiscard]] std::optional<SurfacePoint> received(int code, Place p) const;
  [[nodiscard]] bool isReceived(int code, Place p) const;
  // Of the cell of this spacing whose south-west corner is `p`: how many corners were received.
  [[nodiscard]] int corners(int code, Place p) const;
  // The map at a place: the finest node received there, else between the corners of the finest whole cell
  // that touches it. Depends on the place and the store alone.
  [[nodiscard]] std::optional<SurfacePoint> at(Place p) const;

  [[nodiscard]] bool hasLevel(int code) const { return has_level_[static_cast<std::size_t>(code)]; }

 private:
  [[nodiscard]] const StoredBlock* blockAt(int code, Place p) const;
  [[nodiscard]] std::optional<SurfacePoint> finest(Place p) const;

  ChunkKey centre_;
  std::array<const BlockStore::Chunk*, 9> around_{};  // row by row from the south-west
  std::array<bool, kLevels> has_level_{};
};

// Between four corners (south-west, south-east, north-east, north-west); n and e from 0 to 1.
[[nodiscard]] SurfacePoint between(const std::array<SurfacePoint, 4>& corners, double n, double e);

}  // namespace fathom::monitor

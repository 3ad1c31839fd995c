#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "realtime/kernel/state_archive_fwd.hpp"
#include "recon/geometry/height_tile.hpp"
#include "telemetry/tiles/tile_codec.hpp"
#include "telemetry/tiles/tile_fragments.hpp"

namespace fathom::telemetry {

// Full-resolution tiles as Draco pieces, for requested detail on fast links. Best effort: each is sent once,
// nobody acknowledges it. A short queue; what does not fit is refused. Only Draco allocates after
// construction.
class TileSender {
 public:
  static constexpr std::size_t kTiles = 8;

  explicit TileSender(std::size_t frame_bytes) : frame_bytes_(frame_bytes) { waiting_.reserve(kTiles); }

  [[nodiscard]] bool hasRoom() const { return waiting_.size() < kTiles; }
  // `max_error` of the depths [m]. False: no room.
  bool offer(const HeightTile& tile, double max_error, int colour_bits);
  // The next piece's payload; 0 if there is none.
  [[nodiscard]] std::size_t next(std::span<std::uint8_t> out);
  [[nodiscard]] bool empty() const { return waiting_.empty() && size_ == 0; }

  struct Counters {
    std::uint64_t sent = 0, unsendable = 0;  // tiles
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] std::size_t memoryBytes() const { return kTiles * sizeof(Waiting) + sizeof(*this); }

  // In link_state.cpp, bit by bit.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  struct Waiting {
    HeightTile tile;
    TileCodecConfig codec;
  };
  bool start();

  std::size_t frame_bytes_;
  std::vector<Waiting> waiting_;  // oldest first
  TileId id_;                     // of the one on its way
  std::array<std::uint8_t, kMaxTileBytes> bytes_{};
  std::size_t size_ = 0;
  int fragment_ = 0;
  Counters counters_;
};

}  // namespace fathom::telemetry

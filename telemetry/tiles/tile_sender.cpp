#include "telemetry/tiles/tile_sender.hpp"

#include <algorithm>

namespace fathom::telemetry {

bool TileSender::offer(const HeightTile& tile, double max_error, int colour_bits) {
  if (!hasRoom()) return false;
  TileCodecConfig codec;
  constexpr double kFinest = 0.001, kCoarsest = 1;  // steps that the codec has [m]
  codec.depth_resolution = std::clamp(2 * max_error, kFinest, kCoarsest);
  codec.colour_bits = std::min(colour_bits, kMaxColourBits);
  waiting_.push_back({tile, codec});
  return true;
}

// Encodes the next tile that can be sent.
bool TileSender::start() {
  while (!waiting_.empty()) {
    const Waiting& w = waiting_.front();
    size_ = makeTileId(w.tile, 1, id_) ? encodeTile(w.tile, 1, w.codec, bytes_) : 0;
    if (size_ > 0 && fragmentCount(size_, frame_bytes_) > kMaxFragments) size_ = 0;
    waiting_.erase(waiting_.begin());
    fragment_ = 0;
    if (size_ > 0) return true;
    ++counters_.unsendable;
  }
  return false;
}

std::size_t TileSender::next(std::span<std::uint8_t> out) {
  if (size_ == 0 && !start()) return 0;
  const std::size_t bytes =
      encodeFragment(id_, std::span<const std::uint8_t>(bytes_).first(size_), fragment_, frame_bytes_, out);
  if (++fragment_ == fragmentCount(size_, frame_bytes_)) {
    size_ = 0;
    ++counters_.sent;
  }
  return bytes;
}

}  // namespace fathom::telemetry

#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "telemetry/monitor/codec/codec_surface.hpp"
#include "telemetry/monitor/codec/peers/lattice.hpp"

namespace fathom {
class CommandLine;
}

namespace fathom::monitor {

// A surface through map packets and frames, and back from the frames.
struct CodecFigures {
  std::size_t bytes = 0;  // frames: headers, ids, sequence numbers and CRC included
  std::size_t frames = 0;
  std::size_t nodes = 0;  // heights sent
  double area = 0;        // [m2]
  double max_error = 0;   // of the heights decoded from the frames [m]
  double rms_error = 0;   // [m]
  double encode_ms = 0;   // all packets
  double slowest_ms = 0;  // one packet
  double decode_ms = 0;   // all packets
  [[nodiscard]] double bytesPerArea() const { return static_cast<double>(bytes) / area; }
  [[nodiscard]] double bitsPerNode() const {
    return 8.0 * static_cast<double>(bytes) / static_cast<double>(nodes);
  }
};

struct CodecSettings {
  double max_error = 0.05;  // [m]
  std::size_t frame = 256;  // largest frame [B]
  int colour_bits = 0;      // of brightness
};

// Throws std::runtime_error if a node did not come back, which would be a fault of the codec.
[[nodiscard]] CodecFigures sendSurface(const LatticeSurface& surface, const CodecSettings& settings);

// Squares of side x side nodes, wholly seen, each sent by itself in as few frames as it needs.
struct TileFigures {
  int side = 0;
  std::size_t tiles = 0;
  double mean_bytes = 0;  // frames and all
  std::size_t max_bytes = 0;
  std::size_t in_one_frame = 0;  // tiles
};
[[nodiscard]] TileFigures sendTiles(const LatticeSurface& surface, int side, const CodecSettings& settings);

[[nodiscard]] peers::Lattice toLattice(const LatticeSurface& surface);

// `fathom-monitor codec TERRAIN.ply`: a surface through the map codec and its frames, beside Draco and JPEG
// 2000 held to the same error in the same run.
struct CodecOptions {
  std::filesystem::path terrain;
  double cell = 0.25;       // [m]
  double max_error = 0.05;  // [m]
  long frame = 256;         // [B]
  int colour_bits = 0;
  std::string sampling = "map";
  bool json = false;
};

// Runs it; the exit code. Throws InputError for bad options and bad files.
int runCodec(const CodecOptions& options);
void addCodecCommand(CommandLine& app);

}  // namespace fathom::monitor

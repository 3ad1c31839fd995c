#include "telemetry/monitor/codec/codec_program.hpp"

#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/ply_reader.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/monitor/codec/codec_report.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::monitor {
namespace {

constexpr double kLeastError = 0.001, kMostError = 0.9;  // that a map packet can say [m]
constexpr std::array<int, 2> kTileSides{9, 17};          // nodes

void check(const CodecOptions& options) {
  const std::string file = options.terrain.string();
  if (!telemetry::spacingCode(options.cell))
    throw InputError(file, "--cell", "must be a power of two metres or whole millimetres, 0.001 to 65.52 m");
  if (!(options.max_error >= kLeastError && options.max_error <= kMostError))
    throw InputError(file, "--max-error", "must be 0.001 to 0.9 m");
  if (options.frame < static_cast<long>(telemetry::kMinFrameBytes) ||
      options.frame > static_cast<long>(telemetry::kMaxFrameBytes))
    throw InputError(file, "--frame", "must be 32 to 256 bytes");
  if (options.colour_bits < 0 || options.colour_bits > 6)
    throw InputError(file, "--colour-bits", "must be 0 to 6");
  if (options.sampling != "map" && options.sampling != "point")
    throw InputError(file, "--sampling", "must be map or point");
}

void printTable(const CodecFigures& ours, const std::vector<TileFigures>& tiles,
                const std::vector<peers::PeerResult>& others, const CodecOptions& options) {
  std::printf("%zu nodes, %.1f m2, cells of %g m, error at most %g m, frames of at most %ld B\n", ours.nodes,
              ours.area, options.cell, options.max_error, options.frame);
  std::printf("%-28s %9s %8s %9s %8s %8s %9s\n", "", "bytes", "B/m2", "bit/node", "max [m]", "rms [m]",
              "enc [ms]");
  const auto row = [&](const std::string& name, std::size_t bytes, std::size_t nodes, double max, double rms,
                       double ms, const std::string& note) {
    std::printf("%-28s %9zu %8.3f %9.3f %8.4f %8.4f %9.2f  %s\n", name.c_str(), bytes,
                static_cast<double>(bytes) / ours.area,
                8.0 * static_cast<double>(bytes) / static_cast<double>(nodes), max, rms, ms, note.c_str());
  };
  row("map packets in frames", ours.bytes, ours.nodes, ours.max_error, ours.rms_error, ours.encode_ms,
      std::to_string(ours.frames) + " frames");
  for (const auto& peer : others) {
    if (peer.bytes == 0)
      std::printf("%-28s %9s\n", peer.name.c_str(), "no setting holds the error");
    else
      row(peer.name, peer.bytes, peer.nodes, peer.max_error, peer.rms_error, peer.encode_ms, peer.setting);
  }
  for (const TileFigures& t : tiles)
    std::printf("tiles of %d x %d nodes by themselves: %zu, mean %.1f B, at most %zu B, %zu in one frame\n",
                t.side, t.side, t.tiles, t.mean_bytes, t.max_bytes, t.in_one_frame);
}

void printJson(const CodecFigures& ours, const std::vector<TileFigures>& tiles,
               const std::vector<peers::PeerResult>& others, const CodecOptions& options) {
  nlohmann::ordered_json out{{"bytes", ours.bytes},
                             {"bytes_per_m2", ours.bytesPerArea()},
                             {"bits_per_vertex", ours.bitsPerNode()},
                             {"max_error_m", ours.max_error},
                             {"rms_error_m", ours.rms_error},
                             {"encode_ms", ours.encode_ms},
                             {"decode_ms", ours.decode_ms},
                             {"slowest_packet_ms", ours.slowest_ms},
                             {"frames", ours.frames},
                             {"frame_bytes", options.frame},
                             {"vertices", ours.nodes},
                             {"area_m2", ours.area},
                             {"cell_m", options.cell},
                             {"sampling", options.sampling},
                             {"colour_bits", options.colour_bits}};
  out["peers"] = nlohmann::ordered_json::array();
  for (const auto& peer : others) {
    nlohmann::ordered_json entry{{"name", peer.name}};
    if (peer.bytes == 0)
      entry["bytes"] = nullptr;
    else
      entry.update({{"bytes", peer.bytes},
                    {"max_error_m", peer.max_error},
                    {"rms_error_m", peer.rms_error},
                    {"bytes_per_m2", static_cast<double>(peer.bytes) / ours.area},
                    {"encode_ms", peer.encode_ms},
                    {"setting", peer.setting}});
    out["peers"].push_back(entry);
  }
  out["tiles"] = nlohmann::ordered_json::array();
  for (const TileFigures& t : tiles)
    out["tiles"].push_back({{"side", t.side},
                            {"tiles", t.tiles},
                            {"mean_bytes", t.mean_bytes},
                            {"max_bytes", t.max_bytes},
                            {"in_one_frame", t.in_one_frame}});
  std::printf("%s\n", out.dump().c_str());
}

}  // namespace

CLI::App* addCodecCommand(CLI::App& app, CodecOptions& options) {
  CLI::App* codec = app.add_subcommand(
      "codec", "measures the map codec on a surface, beside Draco and JPEG 2000 held to the same error");
  codec->footer("Example: fathom-monitor codec chamber3.ply --cell 0.25 --max-error 0.05");
  codec->add_option("terrain", options.terrain, "mesh (PLY): x north, y east, z down [m]")->required();
  codec->add_option("--cell", options.cell, "spacing of the lattice [m]")->capture_default_str();
  codec->add_option("--max-error", options.max_error, "largest error of a height [m]")->capture_default_str();
  codec->add_option("--frame", options.frame, "largest frame [B], 32 to 256")->capture_default_str();
  codec
      ->add_option("--colour-bits", options.colour_bits,
                   "send colour with so many bits of brightness (peers: heights only)")
      ->capture_default_str();
  codec
      ->add_option("--sampling", options.sampling,
                   "map: means under a tent one cell wide, as the onboard map gives them; point: the surface "
                   "at the nodes")
      ->capture_default_str();
  codec->add_flag("--json", options.json, "print one line of JSON");
  return codec;
}

int runCodec(const CodecOptions& options) {
  check(options);
  const LatticeSurface surface =
      sampleSurface(readPly(options.terrain), options.cell,
                    options.sampling == "point" ? Sampling::kPoint : Sampling::kMap, options.terrain);
  const CodecSettings settings{options.max_error, static_cast<std::size_t>(options.frame),
                               options.colour_bits};
  const CodecFigures ours = sendSurface(surface, settings);
  std::vector<TileFigures> tiles;
  for (const int side : kTileSides) tiles.push_back(sendTiles(surface, side, settings));
  const auto others = peers::allPeers(toLattice(surface), options.max_error);
  (options.json ? printJson : printTable)(ours, tiles, others, options);
  return kExitSuccess;
}

}  // namespace fathom::monitor

#pragma once

#include <filesystem>
#include <string>

namespace CLI {
class App;
}

namespace fathom::monitor {

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

// Declares the subcommand `codec` and its options.
CLI::App* addCodecCommand(CLI::App& app, CodecOptions& options);
// Runs it; the exit code. Throws InputError for bad options and bad files.
int runCodec(const CodecOptions& options);

}  // namespace fathom::monitor

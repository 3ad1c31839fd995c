#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace fathom::sim {

struct RenderOptions {
  std::string scenario;  // a path or a shipped name
  std::filesystem::path out;
  std::optional<std::int64_t> seed;  // these replace the scenario's own
  std::optional<double> duration_s;  // longest survey
  std::optional<double> scale;       // of the images' sides
  std::optional<double> rate_hz;     // of pairs
  int threads = 0;                   // 0: all
  bool features = false;             // features instead of pictures
  bool force = false;
};

// fathom-sim render: makes a mission folder. Returns the exit code; throws InputError.
int runRender(const RenderOptions& options);

// fathom-sim keys: prints a scenario (the defaults without a name) with every key's unit, range, default and
// meaning.
int runKeys(const std::string& scenario);

}  // namespace fathom::sim

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fathom::uml {

// Result of one power cut of a machine that records the synthetic dive on its own disk.
struct PowerCut {
  std::vector<std::string> wrong;  // violated requirements; empty: none
  bool skipped = false;            // no user-mode Linux here
  bool began = false;              // the recorder had reported something before the cut
  double cut_after_s = 0;
  std::uint64_t offered = 0, durable = 0, found = 0;  // inputs, at the last line before the cut
  std::int64_t lost_ms = 0;                           // age of the oldest input that is not there
  std::uint64_t images = 0, images_without_event = 0, halves = 0, log_bytes_cut = 0;
  std::uint64_t after_restart = 0;  // inputs recorded behind them on the same disk
};

struct PowerCutOptions {
  double cut_after_s = 3;
  int width = 320, height = 240;  // of an image [px]
  // Of what the drive loses that was not flushed (uml_run --volatile-cache); none: a drive that keeps all.
  std::optional<unsigned> drive_seed;
};
// `folder`: an empty one to work in.
[[nodiscard]] PowerCut cutPower(const PowerCutOptions& options, const std::filesystem::path& folder);

}  // namespace fathom::uml

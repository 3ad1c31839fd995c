#pragma once

#include <filesystem>
#include <optional>

namespace fathom::onboard {

// The mapper process, a child of the vehicle process, which starts it with the files of mapper_channel.hpp
// open and kills it when it makes no progress. It reads the same mission, calibration and configuration,
// loads the newest saved state that loads (else the older one, else it begins at the log's beginning),
// follows the log to its end mark, and writes onboard/. It dies with its parent; the vehicle survives it.
// Exit statuses are those of a tool.
struct MapperOptions {
  std::filesystem::path folder;
  std::optional<std::filesystem::path> config;
  bool soft = false;
  bool print_budget = false;  // makes its pools, shows them and ends
};
int runMapper(const MapperOptions& options);

}  // namespace fathom::onboard

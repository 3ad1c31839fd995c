#pragma once

#include <compare>
#include <filesystem>
#include <string>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::test {

// Identity of a dive's sample, played or logged.
struct InputKey {
  std::size_t kind = 0;
  int side = 0;  // of a camera
  std::int64_t utc_ns = 0;
  auto operator<=>(const InputKey&) const = default;
};
[[nodiscard]] InputKey keyOf(const SensorSample& sample);

// Replays the dive by that configuration into `again`: the files of onboard/ that are not the same bytes, or
// not there on both sides, but for those of measured times.
[[nodiscard]] std::vector<std::string> replayDifferences(const std::filesystem::path& dive,
                                                         const std::filesystem::path& config,
                                                         const std::filesystem::path& again);

}  // namespace fathom::test

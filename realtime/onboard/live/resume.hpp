#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/checkpoint/checkpoint_names.hpp"
#include "realtime/onboard/live/hard_tier.hpp"

namespace fathom::onboard {

// Where an earlier run of the vehicle process left a dive. Nothing, for a dive that begins.
struct VehicleResume {
  std::uint64_t position = 0;           // of the next input
  std::int64_t last_ns = 0;             // arrival of the newest input; 0: the dive begins
  std::uint64_t newest_checkpoint = 0;  // number, of any in the log or on the disk
  std::vector<std::string> said;        // what could not be read
  [[nodiscard]] bool any() const { return last_ns != 0; }
};

// Brings navigation to where the log ends: from the newest saved state whose beginning can be read and whose
// mark the log holds, else by the whole log. Throws InputError for a dive that has ended; a log that cannot
// be read is told, and navigation begins anew.
[[nodiscard]] VehicleResume resumeNavigation(const std::filesystem::path& folder,
                                             const CheckpointNames& names, HardTier& hard);

// Of the inputs in the folder's log; 0 where it holds none, or cannot be read.
[[nodiscard]] std::int64_t newestArrival(const std::filesystem::path& folder);

// UTC less the monotonic clock: as an earlier run on this machine, since it was started, had it; else the
// system's; but vehicle time begins behind `last_ns`, the newest arrival of the dive's log (0: the dive
// begins). `clock_behind_ns`, where given, gets by how much the clock lay behind the log's end, 0 where it
// did not.
[[nodiscard]] std::int64_t vehicleClockOffset(const std::filesystem::path& state_folder,
                                              std::int64_t last_ns = 0,
                                              std::int64_t* clock_behind_ns = nullptr);

}  // namespace fathom::onboard

#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/checkpoint/checkpoint_names.hpp"
#include "realtime/onboard/live/hard_tier.hpp"

namespace fathom::onboard {

// State in which an earlier run of the vehicle process left a dive; empty for a new dive.
struct VehicleResume {
  std::uint64_t position = 0;           // of the next input
  std::int64_t last_ns = 0;             // arrival of the newest input; 0: the dive begins
  std::uint64_t newest_checkpoint = 0;  // number, of any in the log or on the disk
  std::vector<std::string> said;        // what could not be read
  [[nodiscard]] bool any() const { return last_ns != 0; }
};

// Brings navigation to the log's end: from the newest saved state with a readable beginning and a mark in the
// log, else by the whole log. Throws InputError for a dive that has ended; an unreadable log is reported, and
// navigation begins without it.
[[nodiscard]] VehicleResume resumeNavigation(const std::filesystem::path& folder,
                                             const CheckpointNames& names, HardTier& hard);

// Newest arrival in the folder's log; 0 if it holds none or cannot be read.
[[nodiscard]] std::int64_t newestArrival(const std::filesystem::path& folder);

// UTC less the monotonic clock: the offset of an earlier run since the machine booted, else the system's;
// later, if vehicle time would not begin after `last_ns`, the newest arrival of the dive's log (0: a new
// dive). `clock_behind_ns`, if given, receives how far the clock was behind the log's end, 0 if it was not.
[[nodiscard]] std::int64_t vehicleClockOffset(const std::filesystem::path& state_folder,
                                              std::int64_t last_ns = 0,
                                              std::int64_t* clock_behind_ns = nullptr);

}  // namespace fathom::onboard

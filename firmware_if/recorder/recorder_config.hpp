#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/config_keys.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

inline constexpr double kGiB = 1024.0 * kMebibyte;  // [bytes]

struct RecorderConfig {
  double sync_interval_s = 0.5;     // everything is synced to the disk this often
  double planned_hours = 5;         // of recording still to come; the log's room is taken beforehand
  double image_reserve_mib = 2048;  // below this much free disk no more images are written
  double log_reserve_mib = 64;      // below this much raw bytes and messages stop too; inputs never stop
  std::size_t image_queue = 4;      // exposures of one camera waiting to be written; each holds its block
  std::size_t raw_queue_kib = 256;  // bytes of one lane waiting to be written
  std::size_t raw_lanes = 8;        // producers of raw bytes and messages
  bool acfr_channels = true;        // ACFR messages beside Fathom's own, for other people's tools
};

// The keys of [recorder] in onboard.toml.
void visitRecorder(KeyVisitor& keys, RecorderConfig& config);

// What the planned hours will take on the disk.
struct PlannedBytes {
  std::uint64_t images = 0, log = 0;
  [[nodiscard]] std::uint64_t total() const { return images + log; }
};
[[nodiscard]] PlannedBytes plannedBytes(const RecorderConfig& config, const MissionConfig& mission,
                                        const StereoRig& rig);

// Bytes that this process may still write to the disk that holds `folder`, or would hold it; 0 when unknown.
[[nodiscard]] std::uint64_t freeBytes(const std::filesystem::path& folder);

// One line when the disk is too small for the plan, saying after how many hours images would stop; "" when
// all is well.
[[nodiscard]] std::string plannedRoomWarning(const RecorderConfig& config, const MissionConfig& mission,
                                             const StereoRig& rig, const std::filesystem::path& folder);

}  // namespace fathom::io

#include "firmware_if/recorder/recorder_config.hpp"

#include <sys/statvfs.h>

#include <algorithm>
#include <cstdio>

#include "firmware_if/recorder/image_stage.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

// Inputs with their ACFR twins and raw bytes: measured 124 MiB an hour with 100 inputs, 200 CAN frames and 5
// PD0 ensembles a second (fathom-report recorder), and some more for health and map messages.
constexpr double kLogBytesPerHour = 160.0 * 1024 * 1024;
constexpr double kSecondsPerHour = 3600;

std::size_t imageBytes(const Camera& camera, PixelFormat format, int bits) {
  ImageView image;
  image.width = camera.width;
  image.height = camera.height;
  image.format = format;
  image.bits = bits;
  return tiffBytes(image);
}

double imageBytesPerHour(const MissionConfig& mission, const StereoRig& rig) {
  const auto& cameras = mission.cameras;
  return kSecondsPerHour * cameras.rate_hz *
         static_cast<double>(imageBytes(rig.left, cameras.left_format, cameras.bits) +
                             imageBytes(rig.right, cameras.right_format, cameras.bits));
}

}  // namespace

void visitRecorder(KeyVisitor& keys, RecorderConfig& c) {
  // The most leaves the disk 0.2 s to answer within the second that a loss of power may cost.
  keys.number("sync_interval_s", c.sync_interval_s, "s", 0.05, 0.8,
              "everything is synced to the disk this often; the rest of the second is for the disk");
  keys.number(
      "planned_hours", c.planned_hours, "h", 0, 1000,
      "of recording still to come: the log's room is taken beforehand, and a disk too small is a warning");
  keys.number("image_reserve_mib", c.image_reserve_mib, "MiB", 0, 1e7,
              "below this much free disk no more images are written; not below log_reserve_mib");
  keys.number("log_reserve_mib", c.log_reserve_mib, "MiB", 0, 1e7,
              "below this much raw bytes and messages stop too; inputs never stop");
  keys.integer("image_queue", c.image_queue, 1, 64,
               "exposures of one camera waiting to be written, each holding a block of the camera's pool");
  keys.integer("raw_queue_kib", c.raw_queue_kib, "KiB", 16, 8192, "bytes waiting in each of the 8 lanes");
  keys.boolean("acfr_channels", c.acfr_channels, "ACFR messages beside Fathom's own");
  keys.require(c.log_reserve_mib <= c.image_reserve_mib, "log_reserve_mib",
               "is above image_reserve_mib; images stop before raw bytes do");
}

PlannedBytes plannedBytes(const RecorderConfig& config, const MissionConfig& mission, const StereoRig& rig) {
  return {static_cast<std::uint64_t>(config.planned_hours * imageBytesPerHour(mission, rig)),
          static_cast<std::uint64_t>(config.planned_hours * kLogBytesPerHour)};
}

std::uint64_t freeBytes(const std::filesystem::path& folder) {
  std::filesystem::path there = std::filesystem::absolute(folder);
  std::error_code error;
  while (!std::filesystem::exists(there, error) && there.has_relative_path()) there = there.parent_path();
  struct statvfs disk = {};
  if (::statvfs(there.c_str(), &disk) != 0) return 0;
  return std::uint64_t{disk.f_bavail} * disk.f_frsize;
}

std::string plannedRoomWarning(const RecorderConfig& config, const MissionConfig& mission,
                               const StereoRig& rig, const std::filesystem::path& folder) {
  const PlannedBytes planned = plannedBytes(config, mission, rig);
  const double reserve = config.image_reserve_mib * kMebibyte, free = static_cast<double>(freeBytes(folder));
  if (static_cast<double>(planned.total()) + reserve <= free) return "";
  const double per_hour = imageBytesPerHour(mission, rig) + kLogBytesPerHour;
  char line[240];
  std::snprintf(line, sizeof line,
                "the disk has %.1f GiB free, %.1f h of recording take %.1f GiB and %.1f GiB stay in reserve: "
                "images would stop after %.1f h",
                free / kGiB, config.planned_hours, static_cast<double>(planned.total()) / kGiB,
                reserve / kGiB, std::max(0.0, free - reserve) / per_hour);
  return line;
}

}  // namespace fathom::io

#include "firmware_if/recorder/recorder_config.hpp"

#include <sys/statvfs.h>

#include <algorithm>
#include <cstdio>

#include "firmware_if/recorder/image_writer.hpp"
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

RecorderConfig readRecorderConfig(const ConfigTable& table, RecorderConfig defaults) {
  RecorderConfig c = defaults;
  // The most leaves the disk 0.2 s to answer within the second that a loss of power may cost.
  c.sync_interval_s = table.number("sync_interval_s", c.sync_interval_s, 0.05, 0.8);
  c.planned_hours = table.number("planned_hours", c.planned_hours, 0, 1000);
  c.image_reserve_mib = table.number("image_reserve_mib", c.image_reserve_mib, 0, 1e7);
  c.log_reserve_mib = table.number("log_reserve_mib", c.log_reserve_mib, 0, 1e7);
  c.image_queue =
      static_cast<std::size_t>(table.integer("image_queue", static_cast<std::int64_t>(c.image_queue), 1, 64));
  c.raw_queue_kib = static_cast<std::size_t>(
      table.integer("raw_queue_kib", static_cast<std::int64_t>(c.raw_queue_kib), 16, 8192));
  c.acfr_channels = table.boolean("acfr_channels", c.acfr_channels);
  if (c.log_reserve_mib > c.image_reserve_mib)
    table.fail("log_reserve_mib", "is above image_reserve_mib; images stop before raw bytes do");
  return c;
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

#include "firmware_if/files/mission_recorder.hpp"

#include <cstdio>

#include "firmware_if/files/civil_time.hpp"
#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/files/mission_folder.hpp"
#include "firmware_if/log/raw_auv.hpp"

namespace fathom::io {

MissionRecorder::MissionRecorder(const std::filesystem::path& folder, const MissionConfig& mission,
                                 const StereoRig& rig, const Config& config)
    : paths_(folder), mission_(prepareMissionFolder(folder, mission, rig, config.replace)), config_(config) {
  log_ = std::make_unique<SensorLogWriter>(paths_.log(), config.acfr_channels ? mission_.vehicle_name : "");
}

MissionRecorder::~MissionRecorder() = default;

void MissionRecorder::syncIfDue(std::int64_t arrival_utc_ns) {
  if (config_.sync_interval_ns <= 0) return;
  // A clock that was set back must not end the syncing.
  const std::int64_t elapsed = arrival_utc_ns - last_sync_utc_ns_;
  if (elapsed >= 0 && elapsed < config_.sync_interval_ns) return;
  log_->flush();
  last_sync_utc_ns_ = arrival_utc_ns;
}

void MissionRecorder::record(std::int64_t arrival_utc_ns, const SensorSample& sample) {
  log_->write(arrival_utc_ns, sample);
  syncIfDue(arrival_utc_ns);
}

void MissionRecorder::recordRaw(std::int64_t arrival_utc_ns, const std::string& source,
                                std::span<const std::uint8_t> bytes) {
  log_->writeRaw(arrival_utc_ns, source, bytes);
  syncIfDue(arrival_utc_ns);
}

void MissionRecorder::recordImage(std::int64_t arrival_utc_ns, ImageEvent event, const ImageView& pixels) {
  if (event.file_name.empty()) event.file_name = imageFileName(event.utc_ns, event.side);
  writeImage(paths_.images() / event.file_name.view(), pixels);
  record(arrival_utc_ns, event);
}

void MissionRecorder::close() {
  log_->flush();
  log_.reset();
  deriveRawAuv(paths_.root);
}

std::filesystem::path deriveRawAuv(const std::filesystem::path& folder) {
  const MissionConfig mission = readMissionConfig(folder);
  const CivilTime start = civilFromUtc(mission.start_utc_ns);
  char time[80];
  std::snprintf(time, sizeof time, "%04d%02d%02d_%02d%02d%02d", start.year, start.month, start.day,
                start.hour, start.minute, start.second);
  const std::filesystem::path path = folder / (mission.vehicle_name + "_" + time + ".RAW.auv");
  SensorLogReader log(folder);
  RawAuvWriter text(path, mission.origin, mission.magnetic_declination);
  while (const auto entry = log.next()) text.write(entry->sample);
  text.commit();
  return path;
}

}  // namespace fathom::io

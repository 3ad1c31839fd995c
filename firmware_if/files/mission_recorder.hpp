#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "firmware_if/files/mission.hpp"
#include "firmware_if/files/sensor_log.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// Makes a mission folder and records into it, live or simulated: mission.toml, stereo.calib, sensors.lcmlog,
// img/, and, on close(), the RAW.auv derived from the log. One thread records.
class MissionRecorder {
 public:
  struct Config {
    // Begin anew in a folder that already holds a mission, removing its log, RAW.auv and img/. Otherwise
    // recording goes on there, as after a restart at sea, and the mission.toml and stereo.calib that lie
    // there stay.
    bool replace = false;
    // The disk is made to hold everything each time that this much arrival time has passed [ns]; 0: only on
    // close(). What a loss of power may cost.
    std::int64_t sync_interval_ns = 1'000'000'000;
    // ACFR messages beside Fathom's own in the log, for other people's tools.
    bool acfr_channels = true;
  };

  // Throws InputError for a folder that cannot be written, that holds other things than a mission, or, when
  // going on, the mission of another vehicle or dive.
  MissionRecorder(const std::filesystem::path& folder, const MissionConfig& mission, const StereoRig& rig,
                  const Config& config);
  // Without close() the log is whole, but there is no RAW.auv.
  ~MissionRecorder();
  MissionRecorder(const MissionRecorder&) = delete;
  MissionRecorder& operator=(const MissionRecorder&) = delete;

  // These throw std::runtime_error when the disk refuses; what was recorded before stays whole.
  void record(std::int64_t arrival_utc_ns, const SensorSample& sample);
  void recordRaw(std::int64_t arrival_utc_ns, const std::string& source, std::span<const std::uint8_t> bytes);
  // Writes the pixels to img/, then the event with the file's name, so that no event names a file that is not
  // there. An empty file_name becomes imageFileName() of its time and side.
  void recordImage(std::int64_t arrival_utc_ns, ImageEvent event, const ImageView& pixels);

  // Writes <vehicle>_<start time>.RAW.auv from the log and ends the recording.
  void close();

  [[nodiscard]] const MissionPaths& paths() const { return paths_; }

 private:
  void syncIfDue(std::int64_t arrival_utc_ns);

  MissionPaths paths_;
  MissionConfig mission_;
  Config config_;
  std::unique_ptr<SensorLogWriter> log_;
  std::int64_t last_sync_utc_ns_ = 0;
};

// Derives the RAW.auv of a mission folder from its log; returns its path.
std::filesystem::path deriveRawAuv(const std::filesystem::path& folder);

}  // namespace fathom::io

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "firmware_if/camera/camera_source.hpp"
#include "firmware_if/log/onboard_input.hpp"
#include "firmware_if/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

struct RecorderConfig {
  double sync_interval_s = 0.5;     // the disk holds everything older than this, at most 1 s
  double planned_hours = 5;         // room taken on the disk beforehand, for the log
  double image_reserve_mib = 2048;  // below this much free disk no more images are written
  double log_reserve_mib = 64;      // below this much raw bytes stop too; inputs go on to the last byte
  std::size_t input_queue = 4096;   // entries
  std::size_t raw_queue_bytes = 4 << 20;
  std::size_t image_queue = 16;  // exposures waiting to be written
};

// Records a live mission into its folder as FORMATS.md lays it out. The real-time side offers, never blocks,
// never takes memory; one best-effort thread calls work(). Full queues and a full disk drop the least
// valuable: images first, then raw bytes, inputs last; everything is counted.
class Recorder {
 public:
  enum class Disk : std::uint8_t { kRoom, kImagesStopped, kRawStopped, kFull };
  struct Counters {
    std::uint64_t inputs = 0, raw_entries = 0, images = 0, bytes = 0, syncs = 0;
    std::uint64_t inputs_dropped = 0, raw_dropped = 0, images_dropped_queue = 0, images_dropped_disk = 0;
    std::uint64_t write_failures = 0;
    std::int64_t worst_sync_ns = 0;
    std::size_t input_high_water = 0, image_high_water = 0;
  };
  // Gives a frame's pixels and takes the hold on it back.
  using ViewOf = std::function<ImageView(const CameraFrame&)>;
  using Release = std::function<void(const CameraFrame&)>;

  // The folder holds mission.toml and stereo.calib (or gets them from the arguments), and perhaps what an
  // earlier run recorded: then recording goes on behind its last whole entry. Throws InputError.
  Recorder(const std::filesystem::path& folder, const MissionConfig& mission, const StereoRig& rig,
           const RecorderConfig& config, ViewOf view_of, Release release);
  ~Recorder();

  // Each of these from one thread of its own; false and counted when the queue is full.
  [[nodiscard]] bool offerInput(const OnboardInput& input) noexcept;     // the sequencing thread only
  [[nodiscard]] bool offerDecision(const OnboardInput& input) noexcept;  // the mapping thread only
  // The frame is held by the caller for the recorder; released when written or dropped.
  bool offerImage(const CameraFrame& frame) noexcept;  // each camera's own thread
  // From any of the `lanes` raw producers, each its own lane number.
  bool offerRaw(std::size_t lane, std::int64_t arrival_utc_ns, std::string_view source,
                std::span<const std::uint8_t> bytes) noexcept;
  // Messages of health and of the map for the log, as they are published; best effort threads, one lane too.
  bool offerMessage(std::size_t lane, std::int64_t utc_ns, std::string_view channel,
                    std::span<const std::uint8_t> data) noexcept;

  // Writes what waits, for at most about `budget_ms`; true when more waits. Only on the recorder's thread.
  bool work(int budget_ms);
  // Everything offered is on the disk; derives RAW.auv. After the producers have ended.
  void close();

  [[nodiscard]] Counters counters() const noexcept;   // any thread
  [[nodiscard]] Disk disk() const noexcept;           // any thread
  [[nodiscard]] double diskFreeMib() const noexcept;  // any thread, as of the last work()

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::io

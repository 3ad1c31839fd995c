#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// Records a live mission into its folder as FORMATS.md lays it out. The real-time side offers, never blocks,
// never takes memory; one best-effort thread calls work(). Full queues and a full disk drop the least
// valuable: images first, then raw bytes and messages, inputs last; everything is counted, and the log says
// in its place what it misses (RecordingGap).
//
// A failing disk never makes a call here fail: work() tries again to open folder and log, after 1 s and then
// at growing intervals up to 30 s. Until the log is open, images are given back at once
// (`images_dropped_disk`), raw bytes and messages are dropped, and inputs wait in their queue; inputs that
// find no room there are refused, and the log says how many when it opens. state() and failure() report it.
//
// The log holds the inputs exactly in the order in which they were offered. An exposure's event is logged
// when its file is on the disk, whole and under its name; therefore a camera's thread offers the image BEFORE
// it hands the frame to the thread that offers the input (an ImageEvent with the frame's utc_ns and its
// imageFileName()).
//
// An input's position in the log is the number of inputs that were offered before it, over all runs of the
// program: what was refused has a position too, decisions have none. LogInputReader counts the same.
class Recorder {
 public:
  enum class Disk : std::uint8_t { kRoom, kImagesStopped, kRawStopped, kFull };
  // kStarting: work() has not yet been called. kFailed: the disk refused the log, or an image, when it was
  // asked last; kRunning again when it takes them. kEnded: close() was called.
  enum class State : std::uint8_t { kStarting, kRunning, kFailed, kEnded };
  struct Counters {
    std::uint64_t inputs = 0, decisions = 0, raw_entries = 0, messages = 0, images = 0;  // written
    std::uint64_t inputs_safe = 0;  // inputs that the disk holds whatever happens
    // Every input before this position is on the disk, or the log on the disk says that it is missing.
    std::uint64_t safe_position = 0;
    // The same of decisions, by their number in this run.
    std::uint64_t decisions_safe = 0;
    std::uint64_t bytes = 0;  // written, log and images
    std::uint64_t syncs = 0, syncs_failed = 0;
    std::uint64_t inputs_dropped = 0, decisions_dropped = 0, raw_dropped = 0;
    std::uint64_t images_dropped_queue = 0;  // too many waited, or the disk was too slow
    std::uint64_t images_dropped_disk = 0;   // no room, or the disk refused
    std::uint64_t images_without_input = 0;  // written, but no input names them
    std::uint64_t write_failures = 0;
    std::uint64_t open_failures = 0;   // tries to open folder and log
    std::int64_t worst_sync_ns = 0;    // that one sync took
    std::int64_t worst_unsafe_ns = 0;  // from offering an input until the disk held it
    std::size_t input_high_water = 0, image_high_water = 0;
  };
  // What an earlier run left in the folder; zeros until the log is open.
  struct Found {
    std::uint64_t log_bytes = 0;             // whole entries
    std::uint64_t log_bytes_cut = 0;         // behind the last whole entry, cut away
    std::uint64_t images_without_event = 0;  // newest images that no entry names; kept
    std::uint64_t half_images_removed = 0;
  };
  struct CloseResult {
    // Everything offered is on the disk, or the log says in its place what is missing.
    bool log_whole = false;
    bool raw_auv = false;  // RAW.auv is there, of all that the log holds
    std::string text;      // what was left out and why, in plain words; "" when nothing was
  };
  // Gives a frame's pixels, and takes the recorder's hold on it back.
  using ViewOf = std::function<ImageView(const CameraFrame&)>;
  using Release = std::function<void(const CameraFrame&)>;

  // Makes the folder, mission.toml and stereo.calib where they are absent; continues behind the last whole
  // entry of an earlier run. Throws InputError for an operator's mistake, never for the disk: a folder that
  // holds other things or another dive, a sensors.lcmlog that is no LCM log. Blocks as long as a disk that
  // does not answer blocks its calls of the system.
  Recorder(const std::filesystem::path& folder, const MissionConfig& mission, const StereoRig& rig,
           const RecorderConfig& config, ViewOf view_of, Release release);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  // Position of the first input of this run: the number of inputs in the log of earlier runs, those that it
  // says are missing included. Before the first offerInput() and the first work().
  void setFirstPosition(std::uint64_t position) noexcept;

  // Each of these from one thread of its own; false and counted when the queue is full.
  [[nodiscard]] bool offerInput(const OnboardInput& input) noexcept;     // the sequencing thread only
  [[nodiscard]] bool offerDecision(const OnboardInput& input) noexcept;  // the mapping thread only
  // The frame is held by the caller for the recorder; released when written, dropped or refused.
  bool offerImage(const CameraFrame& frame) noexcept;  // each camera's own thread
  // From any of the `raw_lanes` producers, each its own lane number. Text longer than 63 bytes and data
  // longer than a quarter of the lane are refused.
  bool offerRaw(std::size_t lane, std::int64_t arrival_utc_ns, std::string_view source,
                std::span<const std::uint8_t> bytes) noexcept;
  // Encoded messages of health and of the map for the log, as they are published; on the producer's lane.
  bool offerMessage(std::size_t lane, std::int64_t utc_ns, std::string_view channel,
                    std::span<const std::uint8_t> data) noexcept;

  // Writes what waits, for at most about `budget_ms` (one image is not interrupted), and syncs when it is
  // time; true when more waits. Only on the recorder's thread, at least every 100 ms. Never throws for the
  // disk.
  bool work(int budget_ms);
  // Writes everything that was offered, syncs it to the disk, and derives RAW.auv, all within about `most_s`;
  // a disk that refuses is asked until then. It takes longer only by one call of the system, which cannot be
  // interrupted. After the producers have ended, on the recorder's thread or after it has ended. Never throws
  // for the disk.
  [[nodiscard]] CloseResult close(double most_s);

  // From any thread.
  [[nodiscard]] Found found() const noexcept;
  [[nodiscard]] Counters counters() const noexcept;
  [[nodiscard]] Disk disk() const noexcept;
  [[nodiscard]] double diskFreeMib() const noexcept;  // as of the last work()
  [[nodiscard]] State state() const noexcept;
  // From any best-effort thread: why kFailed, as "sensors.lcmlog: cannot be opened (Read-only file system)";
  // else "".
  [[nodiscard]] std::string failure() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::io

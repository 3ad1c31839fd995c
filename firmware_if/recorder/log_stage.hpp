#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/recorder/image_stage.hpp"
#include "firmware_if/recorder/input_lane.hpp"
#include "firmware_if/recorder/journal_file.hpp"
#include "firmware_if/recorder/raw_lane.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {

// Moves inputs, decisions, raw bytes and messages from their lanes into the log, by arrival, each lane in its
// own order, and syncs the log to disk. While writes or syncs fail, inputs queue in the log's memory, then
// in the lanes; raw bytes and messages are dropped while the log is not open.
class LogStage {
 public:
  struct Counters {
    std::uint64_t inputs = 0, decisions = 0, raw_entries = 0, messages = 0;  // written
    std::uint64_t inputs_safe = 0;
    std::uint64_t inputs_passed = 0, decisions_passed = 0;  // safe, plus refused ones in a synced gap
    std::uint64_t syncs = 0, syncs_failed = 0;
    std::uint64_t raw_dropped = 0;  // disk nearly full (`with_raw` false), or the log not open
    std::uint64_t write_failures = 0;
    std::int64_t worst_sync_ns = 0, worst_unsafe_ns = 0;
  };

  // `log` may be open or not; `images` say what became of the exposures that inputs name.
  LogStage(const RecorderConfig& config, JournalFile& log, ImageStage& images);

  // One producer thread per lane.
  [[nodiscard]] InputLane& inputs() noexcept { return inputs_; }
  [[nodiscard]] InputLane& decisions() noexcept { return decisions_; }
  [[nodiscard]] RawLane* raw(std::size_t lane) noexcept {
    return lane < raw_.size() ? raw_[lane].get() : nullptr;
  }
  [[nodiscard]] std::uint64_t rawRefused() const noexcept;  // any thread

  // The rest: the recorder's thread only.
  // Moves what waits into the log's memory until an input names an exposure that is not written yet, the
  // memory is full, or `deadline` (monotonic [ns]) is past. `with_raw` false: drops raw bytes and messages.
  void drain(std::int64_t deadline, bool with_raw, const std::string& vehicle_name);
  // Writes the log's memory to the file, and syncs it when due; nothing while the log is not open.
  void handOver();
  // Logs as missing what was refused behind the last input and the last decision, and syncs all to the disk;
  // after the producers have ended and the lanes are empty. True when the disk has it.
  [[nodiscard]] bool end();

  [[nodiscard]] bool waiting();
  // The log is not open, or the disk refused its last write or sync.
  [[nodiscard]] bool refuses() const noexcept { return refuses_write_ || refuses_sync_ || !log_.isOpen(); }
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

 private:
  [[nodiscard]] bool logInput(InputLane& lane, const std::string& vehicle_name);
  [[nodiscard]] bool logRaw(RawLane& lane, const RawLane::Entry& entry, bool with_raw);
  void dropRaw(RawLane& lane);
  void logMissing(const InputLane& lane, std::uint64_t count, std::int64_t arrival_utc_ns);
  void logGap(const RecordingGap& gap);
  void append(std::int64_t arrival_utc_ns, const LogMessage& message, std::int64_t offered_ns);
  void syncIfDue();
  void sync();

  rt::RealClock clock_;
  RecorderConfig config_;
  JournalFile& log_;
  ImageStage& images_;
  InputLane inputs_, decisions_;
  std::vector<std::unique_ptr<RawLane>> raw_;

  Counters counters_;
  std::uint64_t raw_missing_logged_ = 0;
  std::int64_t newest_utc_ns_ = 0;  // arrival of what was logged last
  // Monotonic time at which the oldest entry not yet synced was offered; 0: none.
  std::int64_t oldest_unsafe_ns_ = 0;
  bool refuses_write_ = false, refuses_sync_ = false;  // the latest attempt failed
  bool names_image_ = false;                           // an unsynced event names an image: sync early
  bool blocked_ = false;  // the next input names an exposure that is not written yet
};

}  // namespace fathom::io

#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>

#include "telemetry/monitor/model/monitor_model.hpp"

namespace fathom::monitor {

// What a monitor leaves behind in a folder: received.bin, every accepted frame as it arrived (packets.bin's
// format, flushed frame by frame, so that a computer that was off goes on where it was); frames.log, one line
// a frame; and the exports, written whole by save().
class SessionFiles {
 public:
  // Creates the folder and opens both logs at their ends. Throws InputError if that cannot be.
  explicit SessionFiles(std::filesystem::path folder);

  // Gives every frame of received.bin, of an earlier run, to `take`; returns how many. A damaged tail is cut
  // off and `damage` says so.
  std::size_t reload(const std::function<void(std::span<const std::uint8_t>, std::int64_t)>& take,
                     std::string& damage);
  // Also keeps accepted frames in received.bin, unless `recorded`. frames.log gets `utc_ns verdict type
  // vehicle dive sequence bytes`; "-" for what a rejected frame does not tell. Rejected frames beyond
  // kMaxRejectedLines are not logged, so that noise on the port cannot fill the disk. Throws
  // std::runtime_error when the disk refuses.
  void log(const telemetry::DecodedFrame& frame, std::span<const std::uint8_t> bytes, std::int64_t utc_ns,
           bool recorded);
  // Writes those exports that have changed and exist. Throws std::runtime_error when the disk refuses.
  void save(const MonitorModel& model);

 private:
  static constexpr std::uint64_t kMaxRejectedLines = 100'000;
  std::filesystem::path folder_;
  std::ofstream log_, received_;
  std::uint64_t rejected_lines_ = 0;
  std::uint64_t saved_map_ = UINT64_MAX;
  std::size_t saved_track_ = 0;
  bool saved_origin_ = false;
};

}  // namespace fathom::monitor

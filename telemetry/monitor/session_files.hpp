#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>

#include "telemetry/monitor/monitor_model.hpp"

namespace fathom::monitor {

// What a monitor leaves behind in a folder: map.ply and track.geojson, written whole by save(), and
// frames.log, one line a frame as it arrives.
class SessionFiles {
 public:
  // Creates the folder and begins frames.log. Throws InputError if that cannot be.
  explicit SessionFiles(std::filesystem::path folder);

  // `utc_ns verdict type vehicle dive sequence bytes`; "-" for what a rejected frame does not tell. Rejected
  // frames beyond kMaxRejectedLines are not logged, so that noise on the port cannot fill the disk.
  void log(const telemetry::DecodedFrame& frame, std::size_t bytes, std::int64_t utc_ns);
  // Throws std::runtime_error when the disk refuses. Writes no map before the first tile, no track before its
  // origin is known.
  void save(const MonitorModel& model);

 private:
  static constexpr std::uint64_t kMaxRejectedLines = 100'000;
  std::filesystem::path folder_;
  std::ofstream log_;
  std::uint64_t rejected_lines_ = 0;
  std::uint64_t saved_map_ = 0;
};

}  // namespace fathom::monitor

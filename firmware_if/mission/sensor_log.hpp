#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// One entry of sensors.lcmlog, in the order in which it was recorded.
struct LoggedSample {
  std::int64_t arrival_utc_ns = 0;  // when the recorder had it
  SensorSample sample;
};

// Appends to sensors.lcmlog (LCM event log of the lcm types in firmware_if/lcm/). Crash safe: each entry is
// handed to the system whole, and a log cut anywhere reads up to its last whole entry.
class SensorLogWriter {
 public:
  // An existing log is continued behind its last whole entry. With a `vehicle_name`, samples for which ACFR
  // vehicles have a channel are written there too (log/log_messages.hpp), for other people's tools. Throws
  // InputError for a path that cannot be written.
  explicit SensorLogWriter(const std::filesystem::path& path, std::string vehicle_name = "");
  ~SensorLogWriter();
  SensorLogWriter(const SensorLogWriter&) = delete;
  SensorLogWriter& operator=(const SensorLogWriter&) = delete;

  void write(std::int64_t arrival_utc_ns, const SensorSample& sample);
  // Waits until the disk has it; until then a loss of power may cost the last entries.
  void flush();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Reads the samples of a mission in recorded order: from sensors.lcmlog, or, where there is no log, from the
// RAW.auv. Damaged entries are skipped and counted. Throws InputError if the file is absent, empty, or holds
// no sample at all.
class SensorLogReader {
 public:
  explicit SensorLogReader(const std::filesystem::path& mission_folder);
  ~SensorLogReader();
  SensorLogReader(const SensorLogReader&) = delete;
  SensorLogReader& operator=(const SensorLogReader&) = delete;

  // The next sample; std::nullopt at the end. Entries of other channels are skipped and counted. Throws
  // InputError where the disk refuses to be read.
  [[nodiscard]] std::optional<LoggedSample> next();
  [[nodiscard]] std::uint64_t skippedEntries() const;
  [[nodiscard]] std::uint64_t damagedEntries() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::io

#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "firmware_if/devices/short_text.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// Where a device's samples and bytes go. Called on the thread that polls the device; never blocks.
class SampleSink {
 public:
  virtual ~SampleSink() = default;
  // `arrival_utc_ns`: when the last byte of it reached this machine.
  virtual void sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept = 0;
  // Bytes as they came, for the log: `source` is "RAW_DVL", "RAW_CAN"...; static storage.
  virtual void raw(std::int64_t arrival_utc_ns, std::string_view source,
                   std::span<const std::uint8_t> bytes) noexcept = 0;
};

// State of a device for the operator, the log and the health message, not for control.
struct DeviceHealth {
  std::string_view name;          // "dvl", "can"...; static storage
  bool open = false;              // the device is there
  ShortText<95> reason;           // why it is not, or what its last poll failed with; else empty
  std::int64_t last_data_ns = 0;  // arrival of the newest good sample, UTC; 0: none yet
  std::uint64_t samples = 0;      // good ones given out
  std::uint64_t disconnects = 0;  // times that it went away
  // Every other counter, by name; sized at construction.
  std::vector<std::pair<std::string_view, std::uint64_t>> counters;
};

// One device that gives samples: a serial line, a CAN interface, an LCM bus. One thread polls it. A device
// that is absent or goes away is opened by poll() itself, at most once a second.
class SampleSource {
 public:
  virtual ~SampleSource() = default;
  // Waits at most `timeout_ms` for the device, then hands everything that came to the sink. False, after the
  // whole time, when the device is not there. Takes no memory once it has run. Exceptions of the libraries
  // that it uses come out: PollFence is between it and the thread.
  virtual bool poll(int timeout_ms, SampleSink& sink) = 0;
  // Closes the device; the next poll() opens it again. On the polling thread.
  virtual void close() noexcept {}
  // Refreshes a DeviceHealth that health() gave, without allocating. Only on the polling thread.
  virtual void updateHealth(DeviceHealth& health) const noexcept = 0;
  [[nodiscard]] virtual DeviceHealth health() const = 0;  // set-up only
};

}  // namespace fathom::io

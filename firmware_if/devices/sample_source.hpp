#pragma once

#include <poll.h>

#include <cstdint>
#include <exception>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "firmware_if/devices/short_text.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// Receives the samples and bytes of a device. Called on the thread that polls the device; never blocks.
class SampleSink {
 public:
  virtual ~SampleSink() = default;
  // `arrival_utc_ns`: when the sample's last byte reached this machine.
  virtual void sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept = 0;
  // Bytes as they came, for the log: `source` is "RAW_DVL", "RAW_CAN"...; static storage.
  virtual void raw(std::int64_t arrival_utc_ns, std::string_view source,
                   std::span<const std::uint8_t> bytes) noexcept = 0;
};

// State of a device for the operator, the log and the health message, not for control.
struct DeviceHealth {
  std::string_view name;          // "dvl", "can"...; static storage
  bool open = false;              // the device is there
  ShortText<95> reason = {};      // why the device is not open, or its last poll failed; else empty
  std::int64_t last_data_ns = 0;  // arrival of the newest good sample, UTC; 0: none yet
  std::uint64_t samples = 0;      // valid ones delivered
  std::uint64_t disconnects = 0;  // times that the device was lost
  ShortList<std::pair<std::string_view, std::uint64_t>, 32> counters = {};  // of this device only, by name
  [[nodiscard]] std::uint64_t counter(std::string_view name_of) const noexcept {
    for (const auto& [key, value] : counters)
      if (key == name_of) return value;
    return 0;
  }
};

// One device that gives samples: a serial line, a CAN interface, an LCM bus. One thread polls it. A device
// that is absent or goes away is opened by poll() itself, at most once a second.
class SampleSource {
 public:
  virtual ~SampleSource() = default;
  // Waits at most `timeout_ms` for the device, then hands everything that came to the sink. Returns
  // false, after the whole timeout, if the device is not open. Allocates nothing after its first call. May
  // throw exceptions of the libraries that it uses: call it through PollGuard.
  virtual bool poll(int timeout_ms, SampleSink& sink) = 0;
  // Closes the device; the next poll() opens it again. On the polling thread.
  virtual void close() noexcept {}
  // Allocates nothing. Only on the polling thread.
  [[nodiscard]] virtual DeviceHealth health() const = 0;
};

// Calls poll() of a SampleSource or a CameraSource and catches its exceptions (no memory, an error of a
// library), which never end the polling thread: each is counted and its text kept, and the device is closed
// and polled again after 1, 2, 4... 60 s. A poll that returns false is no failure: the source itself opens
// its device again.
class PollGuard {
 public:
  static constexpr std::int64_t kFirstWait_ns = kSecond_ns, kLongestWait_ns = 60 * kSecond_ns;

  // One poll, or a sleep of `timeout_ms` while the device waits to be polled again.
  template <class Device, class Sink>
  void poll(Device& device, int timeout_ms, Sink& sink, std::int64_t monotonic_ns) noexcept {
    if (!wait_.due(monotonic_ns)) {
      ::poll(nullptr, 0, timeout_ms);
      return;
    }
    try {
      static_cast<void>(device.poll(timeout_ms, sink));
      wait_.succeeded();
      reason_ = {};
      return;
    } catch (const std::exception& e) {
      reason_ = e.what();
    } catch (...) {
      reason_ = "exception of unknown type";
    }
    ++failures_;
    device.close();
    wait_.failed(monotonic_ns);
  }
  // Marks a device whose last poll failed as not open, with the reason.
  void markFailure(DeviceHealth& health) const noexcept {
    if (reason_.empty()) return;
    health.open = false;
    health.reason = reason_;
  }
  // Text of the last poll's exception; empty if it threw none.
  [[nodiscard]] std::string_view reason() const noexcept { return reason_.view(); }
  [[nodiscard]] std::uint64_t failures() const noexcept { return failures_; }

 private:
  rt::RetryWait wait_{kFirstWait_ns, kLongestWait_ns};
  decltype(DeviceHealth::reason) reason_;
  std::uint64_t failures_ = 0;
};

}  // namespace fathom::io

#pragma once

#include <poll.h>

#include <cstdint>
#include <exception>

#include "firmware_if/devices/sample_source.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/retry_wait.hpp"

namespace fathom::io {

// Stands between a device and the thread that polls it, a SampleSource or a CameraSource. An exception of
// poll() (no memory, an error of a library) is counted and its text kept; the device is closed and polled
// again after 1, 2, 4... 60 s. The thread never ends by it.
class PollFence {
 public:
  static constexpr std::int64_t kFirstRestNs = kSecond_ns, kLongestRestNs = 60 * kSecond_ns;

  // One poll, or a rest of `timeout_ms` while the device is not to be asked.
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
  // Marks a device that rests as not there, with the reason.
  void markFailure(DeviceHealth& health) const noexcept {
    if (reason_.empty()) return;
    health.open = false;
    health.reason = reason_;
  }
  // What the last poll threw; empty when it did not.
  [[nodiscard]] std::string_view reason() const noexcept { return reason_.view(); }
  [[nodiscard]] std::uint64_t failures() const noexcept { return failures_; }

 private:
  rt::RetryWait wait_{kFirstRestNs, kLongestRestNs};
  decltype(DeviceHealth::reason) reason_;
  std::uint64_t failures_ = 0;
};

}  // namespace fathom::io

#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string_view>
#include <vector>

#include "firmware_if/devices/poll_fence.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "realtime/kernel/frame_port.hpp"
#include "realtime/kernel/threads/watchdog.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/onboard/live/devices/frame_lender.hpp"
#include "realtime/onboard/live/devices/input_sequencer.hpp"
#include "realtime/onboard/live/devices/own_status.hpp"
#include "realtime/onboard/modem/modem_ring.hpp"

namespace fathom::onboard {

// A device's health, from the thread that polls it to the one that reports. Both are best effort in this
// respect; the hard tier never uses it.
class SharedHealth {
 public:
  explicit SharedHealth(io::DeviceHealth first) : own_(first), shown_(std::move(first)) {}
  // `fill(DeviceHealth&)` refreshes all of it. By the polling thread, without waiting: skipped while the
  // other side reads.
  template <class Fill>
  void update(const Fill& fill) noexcept {
    fill(own_);
    const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (lock.owns_lock()) std::swap(own_, shown_);
  }
  [[nodiscard]] io::DeviceHealth read() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return shown_;
  }

 private:
  mutable std::mutex mutex_;
  io::DeviceHealth own_, shown_;
};

// The thread of one device that gives samples: polls it, passes samples to the hard tier and bytes to the
// recorder. Runs until it is stopped, even if the device throws (PollFence).
class SampleThread final : public io::SampleSink {
 public:
  struct Links {
    InputRing* inputs = nullptr;
    io::Recorder* recorder = nullptr;  // may be null
    std::size_t raw_lane = 0;
    rt::Heartbeat* heart = nullptr;
  };
  SampleThread(io::SampleSource& source, const Links& links, const rt::Clock& clock);

  // Until `stop`; throws where something else than the device fails.
  void run(const std::atomic<bool>& stop);
  // With "poll_failures" behind the device's own counters: polls that threw.
  [[nodiscard]] io::DeviceHealth health() const { return health_.read(); }

  void sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept override;
  void raw(std::int64_t arrival_utc_ns, std::string_view source,
           std::span<const std::uint8_t> bytes) noexcept override;

 private:
  io::SampleSource& source_;
  Links links_;
  const rt::Clock& clock_;
  io::PollFence fence_;
  SharedHealth health_;
};

// The thread of one camera: passes its frames to the recorder and the mapper, their stamps to the hard tier.
// Runs until it is stopped, even if the camera throws (PollFence).
class CameraThread final : public io::FrameSink {
 public:
  struct Links {
    InputRing* stamps = nullptr;
    FrameLender* frames = nullptr;
    io::Recorder* recorder = nullptr;  // may be null
    rt::Heartbeat* heart = nullptr;
  };
  CameraThread(io::CameraSource& camera, const Links& links, const rt::Clock& clock);

  void run(const std::atomic<bool>& stop);
  [[nodiscard]] io::DeviceHealth health() const { return health_.read(); }
  void frame(const io::CameraFrame& frame) noexcept override;

 private:
  io::CameraSource& camera_;
  Links links_;
  const rt::Clock& clock_;
  std::string_view name_;
  io::PollFence fence_;
  SharedHealth health_;
};

// The modem's thread: sends the mapper's frames, or the vehicle's own status while there is no mapper; each
// received link frame goes to the hard tier as an input. Its port waits for an absent device and never
// throws.
class ModemThread {
 public:
  struct Links {
    ModemRing* outgoing = nullptr;
    OwnStatus* own = nullptr;
    InputRing* inputs = nullptr;
    io::Recorder* recorder = nullptr;  // may be null
    std::size_t raw_lane = 0;
    rt::Heartbeat* heart = nullptr;
  };
  struct Counters {
    std::atomic<std::uint64_t> sent{0}, refused{0}, received{0}, dropped{0};  // modem frames
    std::atomic<std::int64_t> last_received_ns{0};                            // vehicle time
    std::atomic<std::uint64_t> own{0};  // status frames of the vehicle itself, of those sent
  };
  ModemThread(FramePort& modem, const Links& links, const rt::Clock& clock);

  void run(const std::atomic<bool>& stop);
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] io::DeviceHealth health() const { return health_.read(); }

 private:
  void receiveAll() noexcept;
  void send(const OutgoingFrame& frame, bool own) noexcept;

  FramePort& modem_;
  Links links_;
  const rt::Clock& clock_;
  Counters counters_;
  SharedHealth health_;
};

}  // namespace fathom::onboard

#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string_view>
#include <vector>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/devices/sample_source.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "realtime/kernel/frame_port.hpp"
#include "realtime/kernel/rings/broadcast_ring.hpp"
#include "realtime/kernel/threads/watchdog.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/onboard/live/hard_tier.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::onboard {

// The vehicle's own status to the ship while no mapper runs, at a slow pace, in frames with sequence numbers
// beyond those that a mapper may have used (noteSent of the link). One thread sets the status, the modem's
// thread takes frames and reports those sent.
class OwnStatus {
 public:
  struct Config {
    telemetry::LinkIdentity identity;
    telemetry::FrameTag tag;
    telemetry::Version first = telemetry::firstVersion(0);  // of the dive
    std::int64_t silent_ns = 30'000'000'000;  // that the link has been before the vehicle speaks itself
    std::int64_t period_ns = 20'000'000'000;  // from status to status
    std::uint16_t passed_over = 64;           // sequence numbers that a lost mapper may have used unseen
    std::size_t padded_bytes = 0;             // size of a padded modem frame; 0: a link frame as it is
  };
  explicit OwnStatus(const Config& config) : config_(config), next_(config.first) {}

  // Some times a second, from one thread. `mapper`: one follows the log and may speak.
  void set(const telemetry::Status& status, bool mapper) noexcept;
  // Any thread: the first version that is free; false where no frame was ever seen.
  [[nodiscard]] bool nextVersion(telemetry::Version& version) const noexcept;

  // The modem's thread. The frame that is due; false for none.
  [[nodiscard]] bool next(std::int64_t now_ns, OutgoingFrame& frame) noexcept;
  // Every modem frame that goes out; `own`: next() gave it.
  bool sent(std::int64_t now_ns, std::span<const std::uint8_t> frame, bool own) noexcept;

 private:
  struct Known {
    telemetry::Status status;
    std::uint64_t mapper = 0;
  };
  Config config_;
  rt::SharedRecord<Known> known_;
  std::atomic<telemetry::Version> next_;  // frame
  std::atomic<bool> any_{false};
  std::int64_t last_ns_ = 0;  // a frame was sent, or listening began
  bool own_turn_ = false;     // the last frame was the vehicle's own
};

// Lends one camera's frames to the mapper: their blocks stay held until the mapper has passed them. At most
// `most` at once: newer frames are not lent to a mapper that stalls or is absent, which reads them from the
// disk later; neither camera nor recorder waits. Used by the camera's thread only.
class FrameLender {
 public:
  // The pool must outlive it. `most`: well below the pool's blocks.
  FrameLender(io::CameraSource& camera, FrameBroadcast& to, const std::atomic<std::uint64_t>& floor,
              std::size_t most);
  ~FrameLender();
  FrameLender(const FrameLender&) = delete;
  FrameLender& operator=(const FrameLender&) = delete;

  // Takes the caller's hold on the frame.
  void lend(const io::CameraFrame& frame) noexcept;

  // Frames that were not lent because the mapper still held too many; from any thread.
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::size_t kMost = 64;  // of any pool
  struct Loan {
    std::uint32_t block = 0;
    std::uint64_t number = 0;
  };
  void takeBack() noexcept;

  io::CameraSource& camera_;
  FrameBroadcast& to_;
  const std::atomic<std::uint64_t>& floor_;
  std::size_t most_;
  std::array<Loan, kMost> loans_{};  // oldest first, from begin_
  std::size_t begin_ = 0, count_ = 0;
  std::atomic<std::uint64_t> refused_{0};
};

// A device's health, from the thread that polls it to the one that reports. Both are best effort in this
// respect; the hard tier never uses it.
class SharedHealth {
 public:
  explicit SharedHealth(const io::DeviceHealth& first) : shown_(first) {}
  // By the polling thread, without waiting: skipped while the other side reads.
  void update(const io::DeviceHealth& health) noexcept {
    const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (lock.owns_lock()) shown_ = health;
  }
  [[nodiscard]] io::DeviceHealth read() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return shown_;
  }

 private:
  mutable std::mutex mutex_;
  io::DeviceHealth shown_;
};

// The thread of one device that gives samples: polls it, passes samples to the hard tier and bytes to the
// recorder. Runs until it is stopped, even if the device throws (PollGuard).
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
  io::PollGuard guard_;
  SharedHealth health_;
};

// The thread of one camera: passes its frames to the recorder and the mapper, their stamps to the hard tier.
// Runs until it is stopped, even if the camera throws (PollGuard).
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
  io::PollGuard guard_;
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

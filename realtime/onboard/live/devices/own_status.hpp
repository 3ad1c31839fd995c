#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

#include "realtime/kernel/rings/broadcast_ring.hpp"
#include "realtime/onboard/modem/modem_ring.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/status.hpp"

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

}  // namespace fathom::onboard

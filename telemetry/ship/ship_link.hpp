#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>

#include "telemetry/downlink/downlink.hpp"
#include "telemetry/ship/link_receiver.hpp"

namespace fathom::telemetry {

struct ShipLinkConfig {
  std::size_t frame_bytes = kMinFrameBytes;  // of the downlink's frames, 32 to 256
  double turn_s = 1;      // after which an unused turn is over: the vehicle sends again [s]
  double silence_s = 60;  // without a frame from the vehicle, after which the ship sends without a turn [s]
};

// The ship's end of the link in both directions: takes turns between LinkReceiver and DownlinkSender. The
// ship sends after a frame that gives it the turn, or after a long silence (the vehicle may be paused, or its
// turns may all be lost). Sans-I/O; no clocks.
class ShipLink {
 public:
  ShipLink(const std::optional<LinkIdentity>& identity, const std::optional<LinkKey>& key,
           const ShipLinkConfig& config = {});

  // Takes one received modem frame: gives each link frame in it to `take`, which accept()s it and returns
  // whether it was accepted; the modem frame itself when it holds none. True: at least one was accepted. The
  // answer is then padded as this modem frame was (frame.hpp).
  using TakeFrame = std::function<bool(std::span<const std::uint8_t> link_frame)>;
  bool receive(std::span<const std::uint8_t> modem_frame, const TakeFrame& take);
  // Takes one link frame that arrived now; see LinkReceiver::accept.
  DecodedFrame accept(std::int64_t now_ns, std::span<const std::uint8_t> frame,
                      const LinkReceiver::Deliver& deliver);
  // Writes the modem frame to send now (out: at least kMaxModemBytes); 0 when it is not the ship's turn or
  // there is nothing to send. `now_ns` is UTC. `kept` is called at the ship's turn: whether all that was
  // received is stored and may be acknowledged; empty: yes.
  using Kept = std::function<bool()>;
  [[nodiscard]] std::size_t nextFrame(std::int64_t now_ns, std::span<std::uint8_t> out) {
    return nextFrame(now_ns, now_ns, out);
  }
  // `said_ns`: the time that the frame carries, UTC.
  [[nodiscard]] std::size_t nextFrame(std::int64_t now_ns, std::int64_t said_ns, std::span<std::uint8_t> out,
                                      const Kept& kept = {});

  // Where requests and fixes are queued. Null until the vehicle is known.
  [[nodiscard]] DownlinkSender* sender() { return sender_ ? &*sender_ : nullptr; }
  [[nodiscard]] const DownlinkSender* sender() const { return sender_ ? &*sender_ : nullptr; }
  [[nodiscard]] const LinkReceiver& receiver() const { return receiver_; }
  // See LinkReceiver.
  void noteDamage() { receiver_.noteDamage(); }

 private:
  void meet(const LinkIdentity& identity);

  std::optional<LinkKey> key_;
  ShipLinkConfig config_;
  LinkReceiver receiver_;
  std::optional<DownlinkSender> sender_;
  int round_ = 0;  // frames sent, in rounds
  std::uint64_t acknowledged_map_frames_ =
      UINT64_MAX;                         // received when the latest frames were acknowledged last
  std::size_t padded_ = 0;                // size of the answer; 0: as long as it is
  std::optional<std::int64_t> turn_ns_;   // since when it is the ship's turn
  std::optional<std::int64_t> quiet_ns_;  // since when no frame was sent or received
};

}  // namespace fathom::telemetry

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>

#include "telemetry/repair/repair_decoder.hpp"
#include "telemetry/ship/held_frames.hpp"
#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// The ship's end of the link: admits frames of one vehicle and dive, once each, repairs lost map packets from
// repair frames, says what to acknowledge, and keeps the account of the rest. Sans-I/O; bounded.
class LinkReceiver {
 public:
  // The message of an accepted frame, or a map packet that was repaired; never a repair frame.
  struct Message {
    MessageType type = MessageType::kStatus;
    Version version = 0;  // rises over the dive, whatever its sender's numbers do
    std::span<const std::uint8_t> payload;
  };
  // Called in the order in which they become known: an older one may come after a newer. False: not valid.
  using Deliver = std::function<bool(const Message&)>;

  // Without an identity the first valid frame's is locked.
  explicit LinkReceiver(std::optional<LinkIdentity> identity = std::nullopt) : identity_(identity) {}

  // Takes one frame in any state; says what became of it.
  DecodedFrame accept(std::span<const std::uint8_t> bytes, const Deliver& deliver);

  // The frame accepted last said "your turn": the vehicle listens now.
  [[nodiscard]] bool turn() const { return turn_; }
  // What to tell the vehicle: the newest sequence number and which of those before it arrived or were
  // repaired, as far back as this receiver has listened, and no further than the last kTurnsBack turns (an
  // answer takes the time in which the vehicle is silent). Not valid before the first frame.
  [[nodiscard]] Acknowledgement acknowledgement() const;
  // The same of frames further back, a place after the other; see HeldFrames::further().
  [[nodiscard]] std::optional<Acknowledgement> furtherAcknowledgement(bool whole_dive) {
    return held_.further(whole_dive);
  }
  // Some of what was accepted before, in the ship's file, is lost: before the frame that is accepted next.
  void noteDamage() { damage_ = true; }

  struct Counters {
    std::array<std::uint64_t, kFrameVerdicts> verdicts{};  // by FrameVerdict
    std::array<std::uint64_t, kMessageTypes> types{};      // accepted, by MessageType
    std::uint64_t frames = 0, bytes = 0;                   // everything given to accept()
    std::uint64_t lost = 0;              // gaps in the sequence numbers that nothing has filled yet
    std::uint64_t repaired = 0;          // gaps filled by repair frames
    std::uint64_t reordered = 0;         // accepted after a later frame
    std::uint64_t resyncs = 0;           // the sender began anew
    std::uint64_t repaired_invalid = 0;  // repaired packets that `deliver` refused
    [[nodiscard]] std::uint64_t operator[](FrameVerdict v) const {
      return verdicts[static_cast<std::size_t>(v)];
    }
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const std::optional<LinkIdentity>& identity() const { return identity_; }

 private:
  // The version of a frame that is new; nothing for one that is not.
  std::optional<Version> admit(std::uint16_t sequence, std::uint32_t crc);
  Version beginAnew(std::uint16_t sequence);
  void repair(const Deliver& deliver);

  // Frames may come this many sequence numbers late and still be told from duplicates. A number that comes
  // again with other content, or kStaleRun rising numbers in a row from before the window: the sender began
  // anew. What follows after however long a silence is an outage.
  static constexpr int kWindow = RepairDecoder::kWindow;
  static constexpr int kStaleRun = 4;
  static constexpr std::size_t kTurnsBack = 3;  // that all of so many answers were lost is unlikely

  enum class State : std::uint8_t { kBeforeStart, kMissing, kSeen, kRepaired };
  struct Slot {
    State state = State::kBeforeStart;
    std::uint32_t crc = 0;  // of the payload seen or repaired
  };
  [[nodiscard]] Slot& slot(Version version) { return slots_[version % static_cast<std::size_t>(kWindow)]; }

  std::optional<LinkIdentity> identity_;
  bool started_ = false, turn_ = false, damage_ = false;
  std::array<Version, kTurnsBack> turns_{};  // the last ones, a ring
  std::size_t turn_count_ = 0;
  Version newest_ = 0;
  std::uint16_t last_stale_ = 0;
  int stale_run_ = 0;
  std::array<Slot, kWindow> slots_{};  // by version % kWindow, for (newest - kWindow, newest]
  HeldFrames held_;
  RepairDecoder repair_;
  Counters counters_;
};

}  // namespace fathom::telemetry

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>

#include "telemetry/repair/repair_decoder.hpp"
#include "telemetry/ship/held_frames.hpp"
#include "telemetry/ship/lap_search.hpp"
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
  explicit LinkReceiver(std::optional<LinkIdentity> identity = std::nullopt, const FrameTag& tag = {})
      : identity_(identity), tag_(tag), laps_(tag.keyed()) {}

  // Takes one frame in any state, heard at `now_ns` (UTC; counts only with a key); says what became of it.
  DecodedFrame accept(std::span<const std::uint8_t> bytes, const Deliver& deliver, std::int64_t now_ns = 0);

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
  // The first version of the dive that is heard now. It changes where another dive begins, or the vehicle has
  // begun anew: what was delivered with earlier versions is of another map.
  [[nodiscard]] Version began() const { return began_; }
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
  // The version of a frame that is new; nothing for one that is not. `header`: with the whole version, or the
  // sequence number alone.
  std::optional<Version> admit(const DecodedFrame& frame, std::uint32_t digest);
  Version beginAnew(Version version);
  Version beginAfterNewest(std::uint16_t sequence);
  std::optional<Version> farBack(const DecodedFrame& frame, Version version, std::uint32_t digest);
  void repair(const Deliver& deliver);

  // A number that comes again with other content, or, where the whole version is not known, kStaleRun rising
  // numbers in a row from before the window: the sender began anew. What follows after however long a silence
  // is an outage; with a key, a whole lap further on it is another dive.
  static constexpr int kWindow = RepairDecoder::kWindow;
  static constexpr int kStaleRun = 4;
  static constexpr std::size_t kTurnsBack = 3;  // that all of so many answers were lost is unlikely

  enum class State : std::uint8_t { kBeforeStart, kMissing, kSeen };
  [[nodiscard]] State& slot(Version version) { return slots_[version % static_cast<std::size_t>(kWindow)]; }

  std::optional<LinkIdentity> identity_;
  FrameTag tag_;
  LapSearch laps_;
  bool started_ = false, turn_ = false, damage_ = false;
  std::array<Version, kTurnsBack> turns_{};  // the last ones, a ring
  std::size_t turn_count_ = 0;
  Version began_ = 0, newest_ = 0;
  Version shift_ = 0;  // whole laps, between the sender's versions and ours
  std::uint16_t last_stale_ = 0;
  int stale_run_ = 0;
  std::array<State, kWindow> slots_{};  // by version % kWindow, for (newest - kWindow, newest]
  HeldFrames held_;
  RepairDecoder repair_;
  Counters counters_;
};

}  // namespace fathom::telemetry

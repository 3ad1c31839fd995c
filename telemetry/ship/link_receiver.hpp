#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>

#include "telemetry/repair/repair_decoder.hpp"
#include "telemetry/ship/lap_search.hpp"
#include "telemetry/ship/ship_frames.hpp"
#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// The ship's end of the uplink: admits frames of one vehicle and dive, each once, recovers lost map packets
// from repair frames, makes the acknowledgements, and counts the rest. Sans-I/O; bounded.
class LinkReceiver {
 public:
  // The message of an accepted frame, or a map packet that was repaired; never a repair frame.
  struct Message {
    MessageType type = MessageType::kStatus;
    Version version = 0;  // rises over the dive, also when the sender's numbers restart
    std::span<const std::uint8_t> payload;
  };
  // Called in order of reception: an older message may come after a newer. Returns false if the message is
  // not valid.
  using Deliver = std::function<bool(const Message&)>;

  // Without an identity the first valid frame's is locked.
  explicit LinkReceiver(std::optional<LinkIdentity> identity = std::nullopt, const FrameTag& tag = {})
      : identity_(identity), tag_(tag), laps_(tag.keyed()) {}

  // Takes one frame of any bytes, received at `now_ns` (UTC; used only with a key), and returns its verdict.
  DecodedFrame accept(std::span<const std::uint8_t> bytes, const Deliver& deliver, std::int64_t now_ns = 0);

  // The frame accepted last said "your turn": the vehicle listens now.
  [[nodiscard]] bool turn() const { return turn_; }
  // Acknowledgement of the newest frame and of those before it that arrived or were repaired, as far back as
  // this receiver has listened and no further than the last kTurnsBack turns (a long answer takes the
  // vehicle's time). Not valid before the first frame.
  [[nodiscard]] Acknowledgement acknowledgement() const;
  // Acknowledgements of frames further back, one place after the other; see ShipFrames::further().
  [[nodiscard]] std::optional<Acknowledgement> furtherAcknowledgement(bool whole_dive) {
    return ship_frames_.further(whole_dive);
  }
  // The first version of the present dive. It changes when another dive begins or the vehicle restarts its
  // numbers: what was delivered with earlier versions is of another map.
  [[nodiscard]] Version began() const { return began_; }
  // Accepted frames before the one accepted next are lost from the ship's file.
  void noteDamage() { damage_ = true; }

  struct Counters {
    std::array<std::uint64_t, kFrameVerdicts> verdicts{};  // by FrameVerdict
    std::array<std::uint64_t, kMessageTypes> types{};      // accepted, by MessageType
    std::uint64_t frames = 0, bytes = 0;                   // everything given to accept()
    std::uint64_t lost = 0;                                // gaps in the sequence numbers, not filled yet
    std::uint64_t repaired = 0;                            // gaps filled by repair frames
    std::uint64_t reordered = 0;                           // accepted after a later frame
    std::uint64_t resyncs = 0;                             // restarts of the sender's numbers
    std::uint64_t repaired_invalid = 0;                    // repaired packets that `deliver` refused
    [[nodiscard]] std::uint64_t operator[](FrameVerdict v) const {
      return verdicts[static_cast<std::size_t>(v)];
    }
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const std::optional<LinkIdentity>& identity() const { return identity_; }

 private:
  // The version under which a frame is admitted; nullopt for a duplicate.
  std::optional<Version> admit(const DecodedFrame& frame, std::uint32_t digest);
  Version restart(Version version);
  Version restartAfterNewest(std::uint16_t sequence);
  std::optional<Version> farBack(const DecodedFrame& frame, Version version, std::uint32_t digest);
  void repair(const Deliver& deliver);

  // The sender has restarted when a number comes again with other content or, without the whole version,
  // after kStaleRun rising numbers in a row from before the window. A silence of any length is an outage;
  // with a key, a frame a whole lap further is of another dive.
  static constexpr int kWindow = RepairDecoder::kWindow;
  static constexpr int kStaleRun = 4;
  static constexpr std::size_t kTurnsBack = 3;  // answers that are unlikely to be lost all

  enum class State : std::uint8_t { kBeforeStart, kMissing, kSeen };
  [[nodiscard]] State& slot(Version version) { return slots_[version % static_cast<std::size_t>(kWindow)]; }

  std::optional<LinkIdentity> identity_;
  FrameTag tag_;
  LapSearch laps_;
  bool started_ = false, turn_ = false, damage_ = false;
  std::array<Version, kTurnsBack> turns_{};  // the last ones, a ring
  std::size_t turn_count_ = 0;
  Version began_ = 0, newest_ = 0;
  Version shift_ = 0;  // between the sender's versions and the receiver's, whole laps
  std::uint16_t last_stale_ = 0;
  int stale_run_ = 0;
  std::array<State, kWindow> slots_{};  // by version % kWindow, for (newest - kWindow, newest]
  ShipFrames ship_frames_;
  RepairDecoder repair_;
  Counters counters_;
};

}  // namespace fathom::telemetry

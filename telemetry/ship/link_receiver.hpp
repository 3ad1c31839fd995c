#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "telemetry/repair/repair.hpp"
#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// Finds the lap of a keyed frame, which the frame leaves out: during a dive the last lap or one beside it;
// otherwise those of a dive of the last day; otherwise any, for one frame a second and accepted only when the
// next frame confirms it. So a forged frame is tried against few laps, and a clock that is years off costs
// two frames. Without a key there is no lap to find.
class LapSearch {
 public:
  explicit LapSearch(bool keyed) : keyed_(keyed) {}
  // `near`: the newest frame of the dive, by its sender's count.
  [[nodiscard]] DecodedFrame decode(std::span<const std::uint8_t> bytes, const FrameTag& tag,
                                    std::optional<Version> near, std::int64_t now_ns);

 private:
  [[nodiscard]] DecodedFrame anyLap(std::span<const std::uint8_t> bytes, const FrameTag& tag,
                                    std::int64_t now_ns);

  bool keyed_;
  std::optional<std::uint16_t> unconfirmed_;
  std::optional<std::int64_t> searched_ns_;
};

// The frames of the dive that the ship has, from the first to the newest, and the acknowledgements of them:
// of the latest frames, and of places further back where frames are missing that the vehicle may count as
// arrived (the dive's beginning, when the ship came late or has lost its file; damage in the file). Bounded:
// of more than kMost frames the oldest half is dropped and counts as received.
class ShipFrames {
 public:
  static constexpr std::size_t kMost = std::size_t{1} << 20;

  void clear() { *this = {}; }
  // Adds a frame; `digest`: of its payload.
  void add(Version version, std::uint32_t digest);
  [[nodiscard]] bool holds(Version version) const { return digestAt(version) != 0; }
  // Whether it has this frame with other content: the sender has restarted and uses numbers again.
  [[nodiscard]] bool holdsOther(Version version, std::uint32_t digest) const {
    return holds(version) && digestAt(version) != shortened(digest);
  }
  // Frames before `version`, which the ship has, are lost from its file.
  void noteDamage(Version version);

  // Acknowledgement of the newest frame and those before it, no further back than `furthest`; not valid
  // without a frame.
  [[nodiscard]] Acknowledgement latest(std::size_t furthest) const;
  // The next acknowledgement of frames further back: each place kReportsOfAPlace times and, with
  // `whole_dive`, in between piece by piece all frames. Nullopt when latest() covers everything.
  [[nodiscard]] std::optional<Acknowledgement> further(bool whole_dive);

 private:
  [[nodiscard]] Acknowledgement before(Version newest, std::size_t furthest) const;
  [[nodiscard]] std::optional<Acknowledgement> nextPlace();
  [[nodiscard]] std::optional<Acknowledgement> nextPiece();
  void addPlace(Version version);
  // Number of missing frames just before `version`; kAll before the first frame.
  [[nodiscard]] std::uint16_t lackingBefore(Version version) const;

  static constexpr std::size_t kMostPlaces = 64;
  static constexpr int kReportsOfAPlace = 4;  // of which most arrive
  static constexpr Version kLongGap = 16;     // frames; shorter gaps are reported piece by piece
  Version base_ = 0, first_ = 0, newest_ = 0;
  // Of a frame; 0 is kept for missing frames.
  [[nodiscard]] static std::uint16_t shortened(std::uint32_t digest) {
    return std::max<std::uint16_t>(1, static_cast<std::uint16_t>(digest));
  }
  [[nodiscard]] std::uint16_t digestAt(Version version) const {
    return version - base_ < digests_.size() ? digests_[version - base_] : std::uint16_t{0};
  }
  std::vector<std::uint16_t> digests_;  // from base_ on
  struct Place {
    Version version = 0;
    int reports = 0;
  };
  std::vector<Place> places_;  // frames before which frames are missing
  bool place_next_ = false;
  Version reported_ = 0;  // frames before it were acknowledged piece by piece in this round
};

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

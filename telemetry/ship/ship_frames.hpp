#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

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

}  // namespace fathom::telemetry

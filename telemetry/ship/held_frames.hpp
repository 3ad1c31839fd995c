#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// Which frames of the dive the ship holds, from the first to the newest: what it tells the vehicle of the
// latest, and of places further back where something is missing that the vehicle may think arrived (the
// dive's beginning, for a ship that came late or has lost its file; damage in the file). Bounded: of more
// than kMost frames the oldest half is forgotten, as if it had been held.
class HeldFrames {
 public:
  static constexpr std::size_t kMost = std::size_t{1} << 20;

  void clear() { *this = {}; }
  // `digest`: of what it carried.
  void hold(Version version, std::uint32_t digest);
  [[nodiscard]] bool holds(Version version) const { return digestAt(version) != 0; }
  // Whether it holds this frame with other content: its sender has begun anew with numbers used before.
  [[nodiscard]] bool holdsOther(Version version, std::uint32_t digest) const {
    return holds(version) && digestAt(version) != shortened(digest);
  }
  // Something that was held before `version`, which is held, is lost.
  void noteDamage(Version version);

  // Of the newest frame held and those before it, no further back than `furthest`; not valid if there is
  // none.
  [[nodiscard]] Acknowledgement latest(std::size_t furthest) const;
  // Of frames further back: each place some times and, for the whole dive, in between piece by piece all
  // of it. Nothing where `latest` says it all.
  [[nodiscard]] std::optional<Acknowledgement> further(bool whole_dive);

 private:
  [[nodiscard]] Acknowledgement before(Version newest, std::size_t furthest) const;
  [[nodiscard]] std::optional<Acknowledgement> nextPlace();
  [[nodiscard]] std::optional<Acknowledgement> nextPiece();
  void addPlace(Version version);
  // Frames not held before `version`, kAll where there is none.
  [[nodiscard]] std::uint16_t lackingBefore(Version version) const;

  static constexpr std::size_t kMostPlaces = 64;
  static constexpr int kTellings = 4;      // most of so many frames arrive
  static constexpr Version kLongGap = 16;  // frames; shorter ones are found piece by piece
  Version base_ = 0, first_ = 0, newest_ = 0;
  // 0 stands for a frame that is not held.
  [[nodiscard]] static std::uint16_t shortened(std::uint32_t digest) {
    return std::max<std::uint16_t>(1, static_cast<std::uint16_t>(digest));
  }
  [[nodiscard]] std::uint16_t digestAt(Version version) const {
    return version - base_ < held_.size() ? held_[version - base_] : std::uint16_t{0};
  }
  std::vector<std::uint16_t> held_;  // from base_ on
  struct Place {
    Version version = 0;
    int told = 0;
  };
  std::vector<Place> places_;  // held frames before which something is missing
  bool place_next_ = false;
  Version told_ = 0;  // frames before it have been spoken of, piece by piece
};

}  // namespace fathom::telemetry

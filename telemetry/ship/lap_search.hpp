#pragma once

#include <cstdint>
#include <optional>
#include <span>

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

}  // namespace fathom::telemetry

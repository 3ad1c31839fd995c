#include "telemetry/ship/lap_search.hpp"

#include <array>
#include <cstdlib>
#include <numeric>
#include <vector>

#include "realtime/base/units.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::int64_t kHour_ns = 3600 * kSecond_ns;
constexpr std::int64_t kSearchInterval_ns = kSecond_ns;
constexpr int kLapsBack = 13;  // of two hours each: a day, and the current one

std::array<std::uint16_t, 3> around(std::uint16_t lap) {
  return {lap, static_cast<std::uint16_t>(lap + 1), static_cast<std::uint16_t>(lap - 1)};
}

}  // namespace

DecodedFrame LapSearch::anyLap(std::span<const std::uint8_t> bytes, const FrameTag& tag,
                               std::int64_t now_ns) {
  if (unconfirmed_) {
    const auto laps = around(*unconfirmed_);
    const DecodedFrame frame = decodeFrame(bytes, tag, laps);
    if (frame.verdict == FrameVerdict::kAccepted) {
      unconfirmed_.reset();
      return frame;
    }
  }
  DecodedFrame refused = peekFrame(bytes);
  refused.verdict = FrameVerdict::kBadTag;
  if (searched_ns_ && std::abs(now_ns - *searched_ns_) < kSearchInterval_ns) return refused;
  searched_ns_ = now_ns;
  std::vector<std::uint16_t> laps(std::size_t{1} << 16);
  std::iota(laps.begin(), laps.end(), std::uint16_t{0});
  const DecodedFrame frame = decodeFrame(bytes, tag, laps);
  if (frame.verdict == FrameVerdict::kAccepted) unconfirmed_ = lapOf(frame.header.version);
  return refused;
}

DecodedFrame LapSearch::decode(std::span<const std::uint8_t> bytes, const FrameTag& tag,
                               std::optional<Version> near, std::int64_t now_ns) {
  if (!keyed_) return decodeFrame(bytes, tag);
  DecodedFrame frame;
  if (near) {
    // The lap that makes the frame nearest to the newest, then those beside it.
    const auto sequence = static_cast<std::uint16_t>(peekFrame(bytes).header.version);
    const auto laps = around(lapOf(versionNear(sequence, *near)));
    frame = decodeFrame(bytes, tag, laps);
    // A repair frame's own tag is shorter, and it follows frames whose lap is known.
    if (frame.verdict != FrameVerdict::kBadTag || frame.header.type == MessageType::kRepair) return frame;
  }
  std::array<std::uint16_t, kLapsBack + 1> recent{};
  for (std::size_t k = 0; k < recent.size(); ++k)
    recent[k] = static_cast<std::uint16_t>(lapOf(firstVersion(now_ns + 2 * kHour_ns)) - k);
  frame = decodeFrame(bytes, tag, recent);
  return frame.verdict == FrameVerdict::kBadTag ? anyLap(bytes, tag, now_ns) : frame;
}

}  // namespace fathom::telemetry

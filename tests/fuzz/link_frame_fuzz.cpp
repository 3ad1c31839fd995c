// Frames as they come off the modem, and every message inside a frame.
#include <array>
#include <cstdlib>

#include "telemetry/frame.hpp"
#include "telemetry/mission_info.hpp"
#include "telemetry/status.hpp"
#include "telemetry/track.hpp"

using namespace fathom::telemetry;

namespace {

void check(bool good) {
  if (!good) std::abort();
}

// Whatever decodes as a track must encode and decode to itself.
void track(std::span<const std::uint8_t> payload) {
  std::array<TrackPoint, kMaxTrackPoints> points, again;
  const std::size_t count = decodeTrack(payload, points);
  if (count == 0) return;
  std::array<std::uint8_t, 4096> buffer;
  const std::size_t size = encodeTrack(std::span<const TrackPoint>(points).first(count), buffer);
  check(size > 0 && decodeTrack(std::span<const std::uint8_t>(buffer).first(size), again) == count);
  for (std::size_t i = 0; i < count; ++i)
    check(points[i].utc_ns == again[i].utc_ns && points[i].north == again[i].north);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::uint8_t> bytes(data, size);
  const DecodedFrame frame = decodeFrame(bytes);
  if (frame.verdict == FrameVerdict::kAccepted) {
    std::array<std::uint8_t, kMaxFrameBytes> out;
    check(encodeFrame(frame.header, frame.payload, out) == size);
    check(std::equal(bytes.begin(), bytes.end(), out.begin()));
  }
  Status status;
  std::array<std::uint8_t, kStatusBytes> out;
  if (decodeStatus(bytes, status)) check(encodeStatus(status, out) == size);
  MissionInfo info;
  if (decodeMissionInfo(bytes, info)) check(info.vehicle_name.size() <= kMaxNameBytes);
  track(bytes);
  return 0;
}

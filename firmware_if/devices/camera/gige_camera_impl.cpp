#include "firmware_if/devices/camera/gige_camera_impl.hpp"

#include <algorithm>

#include "realtime/base/units.hpp"

namespace fathom::io {

using namespace gige;  // NOLINT: its own parts

namespace {

constexpr std::int64_t kOldestFrameNs = 2 * kSecond_ns;           // that waits for the polling thread
constexpr std::uint64_t kLatestStampNs = std::uint64_t{1} << 62;  // what is later is damaged
// Frames that can have been missed: by the rate that is set, with room for a trigger that is faster.
constexpr double kMostMissedShare = 4;
constexpr std::uint64_t kMostMissed = 8;
constexpr int kReadingTries = 4;
constexpr std::int64_t kGoodReading_ns = kMillisecond_ns / 2;
constexpr std::uint32_t kLatchStamp = 2;  // bit 30 of 32, as the standard counts them

}  // namespace

void GigeCamera::Impl::readStatistics() {
  guint64 completed = 0, failures = 0, underruns = 0, resent = 0, missing = 0;
  arv_stream_get_statistics(stream.get(), &completed, &failures, &underruns);
  arv_gv_stream_get_statistics(ARV_GV_STREAM(stream.get()), &resent, &missing);
  count(Count::kNoBuffer, underruns - stream_underruns);
  count(Count::kResentPackets, resent - stream_resent);
  stream_underruns = underruns;
  stream_resent = resent;
}

// Reads the camera's clock between two looks at the vehicle's.
void GigeCamera::Impl::readClock() {
  const std::int64_t start = now();
  if (ticks_per_s == 0 || config.trigger == CameraTrigger::kPtp || start < next_reading_ns) return;
  next_reading_ns = start + reading_gap_ns;
  reading_gap_ns = std::min(2 * reading_gap_ns, kLongestReadingGapNs);
  ArvDevice* device = arv_camera_get_device(camera.get());
  AravisError error;
  std::uint64_t ticks = 0;
  std::int64_t utc_ns = 0, uncertainty_ns = INT64_MAX;
  // On a busy machine a round trip may take long; the shortest of a few counts.
  for (int i = 0; i < kReadingTries && uncertainty_ns > kGoodReading_ns; ++i) {
    std::uint32_t high = 0, low = 0;
    const std::int64_t before = now();
    if (!arv_device_write_register(device, kStampControl, kLatchStamp, error.out())) return;
    const std::int64_t half = (now() - before) / 2;
    if (!arv_device_read_register(device, kStampHigh, &high, error.out()) ||
        !arv_device_read_register(device, kStampLow, &low, error.out()))
      return;
    if (half >= uncertainty_ns) continue;
    ticks = std::uint64_t{high} << 32 | low;
    utc_ns = before + half;
    uncertainty_ns = half;
  }
  // A camera without a latch leaves the registers at zero.
  if (ticks == 0) {
    ticks_per_s = 0;
    return clock.noReadings();
  }
  const long double seconds = static_cast<long double>(ticks) / static_cast<long double>(ticks_per_s);
  clock.addReading(
      static_cast<std::int64_t>(std::min(seconds * 1e9L, static_cast<long double>(kLatestStampNs))), utc_ns,
      uncertainty_ns);
}

// Whether the frame is what was asked for; counts why not.
bool GigeCamera::Impl::whole(ArvBuffer* buffer) {
  switch (arv_buffer_get_status(buffer)) {
    case ARV_BUFFER_STATUS_SUCCESS:
      break;
    case ARV_BUFFER_STATUS_CLEARED:
      return false;  // never filled: the stream was stopped
    case ARV_BUFFER_STATUS_TIMEOUT:
    case ARV_BUFFER_STATUS_ABORTED:
      count(Count::kTimedOut);
      return false;
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      count(Count::kWrongSize);
      return false;
    default:
      count(Count::kIncomplete);
      return false;
  }
  const ArvBufferPayloadType payload = arv_buffer_get_payload_type(buffer);
  if ((payload != ARV_BUFFER_PAYLOAD_TYPE_IMAGE && payload != ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA) ||
      static_cast<std::uint32_t>(arv_buffer_get_image_pixel_format(buffer)) != config.format.code) {
    count(Count::kWrongFormat);
    return false;
  }
  int x = 0, y = 0, width = 0, height = 0, x_padding = 0, y_padding = 0;
  arv_buffer_get_image_region(buffer, &x, &y, &width, &height);
  arv_buffer_get_image_padding(buffer, &x_padding, &y_padding);
  std::size_t bytes = 0;
  const void* data = arv_buffer_get_image_data(buffer, &bytes);
  if (data == nullptr || width != config.width || height != config.height || x_padding != 0 ||
      y_padding != 0 || bytes < wireBytes(config.format.packing, pixelsOf(config))) {
    count(Count::kWrongSize);
    return false;
  }
  return true;
}

void GigeCamera::Impl::take(ArvBuffer* buffer, FrameSink& sink) {
  if (arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_CLEARED) return;
  const std::int64_t utc_ns = now();
  const std::int64_t since_last_ns = utc_ns - last_whole_ns;
  last_frame_ns = utc_ns;
  sent_since_open = true;
  first_frame.frameCame();
  const auto device_ns =
      static_cast<std::int64_t>(std::min<std::uint64_t>(arv_buffer_get_timestamp(buffer), kLatestStampNs));
  // A frame that is not whole has used up its id, but which that was nobody knows: its leader may be missing,
  // and then the buffer still has the id and the stamp of an older frame.
  if (!whole(buffer)) {
    ++broken_since_whole;
    return;
  }
  if (any_stamp && device_ns <= newest_stamp_ns && newest_stamp_ns - device_ns < kOldestFrameNs)
    return count(Count::kStale);
  const auto most_missed = static_cast<std::uint64_t>(kMostMissedShare * config.rate_hz *
                                                      static_cast<double>(since_last_ns) * 1e-9) +
                           kMostMissed;
  const FrameIdUnwrap::Step step = ids.add(arv_buffer_get_frame_id(buffer), most_missed);
  count(Count::kMissed, step.missed - std::min(step.missed, broken_since_whole));
  count(Count::kIdJumps, step.jumped ? 1 : 0);
  broken_since_whole = 0;
  any_stamp = true;
  newest_stamp_ns = device_ns;
  last_whole_ns = utc_ns;

  CameraFrame frame;
  frame.side = config.side;
  frame.frame_id = step.id;
  frame.device_ns = device_ns;
  frame.arrival_utc_ns = utc_ns;
  const auto leader_ns = static_cast<std::int64_t>(arv_buffer_get_system_timestamp(buffer));
  frame.utc_ns = clock.utcNs(frame.device_ns, received.toVehicle(leader_ns, systemNs(), utc_ns),
                             clock_state ? clock_state().error_ns : 0);
  frame.exposure_s = identity.exposure_s;
  frame.gain_db = identity.gain_db;
  if (!clock.settled()) return count(Count::kClockUnsettled);
  frame.block = blocks.acquire();
  if (frame.block == rt::SharedBlocks::kNone) return count(Count::kPoolFull);
  std::size_t bytes = 0;
  const void* data = arv_buffer_get_image_data(buffer, &bytes);
  if (!unpackPixels(config.format.packing, pixelsOf(config), {static_cast<const std::byte*>(data), bytes},
                    blocks.bytes(frame.block))) {
    blocks.release(frame.block);
    return count(Count::kWrongSize);
  }
  ++frames;
  last_data_ns = frame.arrival_utc_ns;
  sink.frame(frame);
}

}  // namespace fathom::io

#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <string>
#include <utility>
#include <vector>

#include "firmware_if/devices/camera/camera_clock_map.hpp"
#include "firmware_if/devices/camera/camera_setup.hpp"
#include "firmware_if/devices/camera/gige_camera.hpp"
#include "firmware_if/devices/vehicle_time.hpp"
#include "realtime/base/units.hpp"

// What a GigeCamera holds: gige_camera.cpp opens, watches and closes it, gige_camera_impl.cpp takes its
// frames and reads its clock.
namespace fathom::io::gige {

enum class Count : std::uint8_t {
  kIncomplete,
  kTimedOut,
  kWrongSize,
  kWrongFormat,
  kMissed,
  kIdJumps,
  kStale,
  kPoolFull,
  kNoBuffer,
  kResentPackets,
  kClockResets,
  kClockHeld,
  kClockUnsettled,
  kPtpApart,
  kControlLost,
  kStalled,
  kNoFirstFrame,
  kOpenFailed,
  kPriorityRefused,
  kReceiveBufferSmall,
  kCounts
};
constexpr std::size_t kCounts = static_cast<std::size_t>(Count::kCounts);
constexpr std::int64_t kLeastSilenceNs = 2 * kSecond_ns;  // whatever the rate
constexpr std::int64_t kStartUpNs = 3 * kSecond_ns;       // from the opening to a camera's first exposure
constexpr std::size_t kMostChunkBytes = std::size_t{1} << 16;  // beside the pixels of a frame

// The camera's clock is read on command at 0, 1, 3, 7... s, then every ten: often while the drift is not
// known.
constexpr std::int64_t kFirstReadingGapNs = kSecond_ns, kLongestReadingGapNs = 10 * kSecond_ns;
// Bootstrap registers of the time stamp (GigE Vision 2.0, section 28).
constexpr std::uint64_t kStampFrequencyHigh = 0x093c, kStampFrequencyLow = 0x0940, kStampControl = 0x0944,
                        kStampHigh = 0x0948, kStampLow = 0x094c;

inline std::size_t pixelsOf(const CameraConfig& config) {
  return static_cast<std::size_t>(config.width) * static_cast<std::size_t>(config.height);
}
inline std::size_t bufferBytes(const CameraConfig& config) {
  return wireBytes(config.format.packing, pixelsOf(config)) + kMostChunkBytes;
}

}  // namespace fathom::io::gige

namespace fathom::io {

struct GigeCamera::Impl {
  Impl(const CameraConfig& c, VehicleTime n, VehicleClockState s, rt::MemoryLock lock)
      : config(c),
        now(std::move(n)),
        clock_state(std::move(s)),
        blocks(c.pool_frames, frameBytes(c.format.packing, gige::pixelsOf(c))),
        memory(c.buffers * (gige::bufferBytes(c) + kBufferAlignment), lock),
        clock(c.trigger == CameraTrigger::kPtp ? CameraClockMap::Mode::kPtp : CameraClockMap::Mode::kFree,
              static_cast<std::int64_t>(c.stamp_to_packet_ms * static_cast<double>(kMillisecond_ns))),
        first_frame(silenceNs(c) + gige::kStartUpNs) {
    for (std::size_t i = 0; i < c.buffers; ++i)
      buffers.emplace_back(
          arv_buffer_new(gige::bufferBytes(c), memory.allocate(gige::bufferBytes(c), kBufferAlignment)));
  }
  ~Impl() { close(!control_lost.load()); }

  bool poll(int timeout_ms, FrameSink& sink);
  void open();
  // `answers`: the camera is there, and its acquisition is stopped first; one that is gone would be waited
  // for.
  void close(bool answers);
  bool lost();
  void take(ArvBuffer* buffer, FrameSink& sink);
  [[nodiscard]] bool whole(ArvBuffer* buffer);
  [[nodiscard]] static std::int64_t systemNs() { return g_get_real_time() * kMicrosecond_ns; }
  void readClock();
  void readStatistics();
  [[nodiscard]] std::int64_t silenceNs() const { return silenceNs(config); }
  [[nodiscard]] static std::int64_t silenceNs(const CameraConfig& c) {
    return std::max(gige::kLeastSilenceNs, static_cast<std::int64_t>(kSilentPeriods / c.rate_hz * 1e9));
  }
  void count(gige::Count what, std::uint64_t events = 1) { counts[static_cast<std::size_t>(what)] += events; }

  static void onStream(void* self, ArvStreamCallbackType type, ArvBuffer* buffer);
  static void onControlLost(ArvGvDevice*, Impl* self) { self->control_lost.store(true); }

  static constexpr std::size_t kBufferAlignment = 64;
  CameraConfig config;
  VehicleTime now;
  VehicleClockState clock_state;
  rt::SharedBlocks blocks;
  rt::Arena memory;
  std::vector<GObjectPtr<ArvBuffer>> buffers;  // one reference is ours: they outlive the streams

  GObjectPtr<ArvCamera> camera;
  GObjectPtr<ArvStream> stream;
  CameraIdentity identity;
  std::string failure;
  gulong control_lost_handler = 0;
  std::atomic<bool> control_lost{false}, priority_refused{false};

  CameraClockMap clock;
  ReceiveTime received;  // Aravis notes by the system's clock when a frame's leader came
  FirstFrameWait first_frame;
  FrameIdUnwrap ids;
  std::uint64_t ticks_per_s = 0;  // of the clock's registers; 0: it has none
  std::int64_t next_reading_ns = 0, reading_gap_ns = 0;

  std::int64_t next_open_ns = 0, last_frame_ns = 0, last_whole_ns = 0;  // vehicle's time
  std::uint64_t broken_since_whole = 0;
  std::int64_t newest_stamp_ns = 0;  // by the camera's clock, since it was opened
  bool any_stamp = false, sent_since_open = false, opened_before = false;
  std::int64_t last_data_ns = 0;
  std::uint64_t frames = 0, disconnects = 0;
  std::uint64_t stream_underruns = 0, stream_resent = 0;  // of the open stream, already counted
  std::array<std::uint64_t, gige::kCounts> counts{};
};

}  // namespace fathom::io

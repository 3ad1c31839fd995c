#include "firmware_if/camera/gige_camera.hpp"

#include <netinet/in.h>
#include <pthread.h>
#include <sched.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <thread>

#include "firmware_if/camera/aravis_handles.hpp"
#include "firmware_if/camera/camera_clock_map.hpp"
#include "firmware_if/camera/camera_setup.hpp"
#include "firmware_if/camera/frame_id_unwrap.hpp"

namespace fathom::io {
namespace {

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
  kOpenFailed,
  kPriorityRefused,
  kReceiveBufferSmall,
  kCounts
};
constexpr std::size_t kCounts = static_cast<std::size_t>(Count::kCounts);
constexpr std::array<std::string_view, kCounts> kNames{
    "incomplete",   "timed_out",   "wrong_size",       "wrong_format",        "missed",
    "id_jumps",     "stale",       "pool_full",        "no_buffer",           "resent_packets",
    "clock_resets", "clock_held",  "clock_unsettled",  "ptp_apart",           "control_lost",
    "stalled",      "open_failed", "priority_refused", "receive_buffer_small"};

constexpr std::int64_t kNsPerMs = 1'000'000, kNsPerUs = 1'000;
constexpr std::int64_t kNsPerS = 1'000'000'000;
constexpr std::int64_t kRetryNs = kNsPerS;             // between attempts to open
constexpr std::int64_t kLeastSilenceNs = 2 * kNsPerS;  // whatever the rate
constexpr std::int64_t kOldestFrameNs = 2 * kNsPerS;   // that waits for the polling thread
constexpr int kMostDescriptors = 4096;
constexpr std::uint64_t kLatestStampNs = std::uint64_t{1} << 62;  // what is later is damaged
// Frames that can have been missed: by the rate that is set, with room for a trigger that is faster.
constexpr double kMostMissedShare = 4;
constexpr std::uint64_t kMostMissed = 8;
constexpr std::size_t kMostChunkBytes = std::size_t{1} << 16;  // beside the pixels of a frame

// The camera's clock is read on command at 0, 1, 3, 7... s, then every ten: the first readings come before
// the drift is known, and between the later ones it is.
constexpr std::int64_t kFirstReadingGapNs = kNsPerS, kLongestReadingGapNs = 10 * kNsPerS;
constexpr int kReadingTries = 4;
constexpr std::int64_t kCloseReadingNs = kNsPerMs / 2;
// Bootstrap registers of the time stamp (GigE Vision 2.0, section 28).
constexpr std::uint64_t kStampFrequencyHigh = 0x093c, kStampFrequencyLow = 0x0940, kStampControl = 0x0944,
                        kStampHigh = 0x0948, kStampLow = 0x094c;
constexpr std::uint32_t kLatchStamp = 2;  // bit 30 of 32, as the standard counts them

std::size_t pixelsOf(const CameraConfig& config) {
  return static_cast<std::size_t>(config.width) * static_cast<std::size_t>(config.height);
}
std::size_t bufferBytes(const CameraConfig& config) {
  return wireBytes(config.format.packing, pixelsOf(config)) + kMostChunkBytes;
}

// Aravis' own setting stops at net.core.rmem_max, which no frame fits; CAP_NET_ADMIN goes beyond it. The
// socket is found by its port. False when its buffer is smaller than asked.
bool widenReceiveBuffer(std::uint16_t port, std::size_t bytes) {
  for (int fd = 0; fd < kMostDescriptors; ++fd) {
    sockaddr_in own{};
    socklen_t size = sizeof own;
    int type = 0;
    socklen_t type_size = sizeof type;
    if (::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_size) != 0 || type != SOCK_DGRAM) continue;
    if (::getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) != 0 || own.sin_family != AF_INET ||
        ntohs(own.sin_port) != port)
      continue;
    const int wanted = static_cast<int>(bytes);
    if (::setsockopt(fd, SOL_SOCKET, SO_RCVBUFFORCE, &wanted, sizeof wanted) != 0)
      ::setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &wanted, sizeof wanted);
    int got = 0;
    socklen_t got_size = sizeof got;
    return ::getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &got, &got_size) == 0 && got >= wanted;
  }
  return false;
}

}  // namespace

struct GigeCamera::Impl {
  Impl(const CameraConfig& c, VehicleTime n, rt::MemoryLock lock)
      : config(c),
        now(std::move(n)),
        blocks(c.pool_frames, frameBytes(c.format.packing, pixelsOf(c)), lock),
        memory(c.buffers * (bufferBytes(c) + kBufferAlignment), lock),
        clock(c.trigger == CameraTrigger::kPtp ? CameraClockMap::Mode::kPtp : CameraClockMap::Mode::kFree,
              static_cast<std::int64_t>(c.stamp_to_packet_ms * static_cast<double>(kNsPerMs))) {
    for (std::size_t i = 0; i < c.buffers; ++i)
      buffers.emplace_back(arv_buffer_new(bufferBytes(c), memory.allocate(bufferBytes(c), kBufferAlignment)));
  }
  ~Impl() { close(!control_lost.load()); }

  bool poll(int timeout_ms, FrameSink& sink);
  void open();
  // `answers`: the camera is there and is told to stop; one that is gone would be waited for.
  void close(bool answers);
  bool lost();
  void take(ArvBuffer* buffer, FrameSink& sink);
  [[nodiscard]] bool whole(ArvBuffer* buffer);
  [[nodiscard]] static std::int64_t firstPacketUtcNs(ArvBuffer* buffer, std::int64_t utc_ns);
  void readClock();
  void readStatistics();
  [[nodiscard]] std::int64_t silenceNs() const {
    return std::max(kLeastSilenceNs, static_cast<std::int64_t>(kSilentPeriods / config.rate_hz * 1e9));
  }
  void count(Count what, std::uint64_t events = 1) { counts[static_cast<std::size_t>(what)] += events; }

  static void onStream(void* self, ArvStreamCallbackType type, ArvBuffer* buffer);
  static void onControlLost(ArvGvDevice*, Impl* self) { self->control_lost.store(true); }

  static constexpr std::size_t kBufferAlignment = 64;
  CameraConfig config;
  VehicleTime now;
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
  std::array<std::uint64_t, kCounts> counts{};
};

void GigeCamera::Impl::onStream(void* user, ArvStreamCallbackType type, ArvBuffer*) {
  auto* self = static_cast<Impl*>(user);
  if (type != ARV_STREAM_CALLBACK_TYPE_INIT || self->config.receive_priority == 0) return;
  sched_param parameters{};
  parameters.sched_priority = self->config.receive_priority;
  if (::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters) != 0)
    self->priority_refused.store(true, std::memory_order_relaxed);
}

void GigeCamera::Impl::open() {
  next_open_ns = now() + kRetryNs;
  control_lost.store(false);
  camera = openCamera(config, identity, failure);
  if (camera == nullptr) return count(Count::kOpenFailed);

  ArvDevice* device = arv_camera_get_device(camera.get());
  control_lost_handler = g_signal_connect(device, "control-lost", G_CALLBACK(&Impl::onControlLost), this);
  AravisError error;
  stream.reset(arv_camera_create_stream(camera.get(), &Impl::onStream, this, error.out()));
  if (error.failed() || stream == nullptr) {
    failure = "gives no stream: " + error.text();
    count(Count::kOpenFailed);
    return close(true);
  }
  // All of a frame may come before the receiving thread runs.
  if (!widenReceiveBuffer(arv_gv_stream_get_port(ARV_GV_STREAM(stream.get())), 2 * bufferBytes(config)))
    count(Count::kReceiveBufferSmall);
  for (const auto& buffer : buffers)
    arv_stream_push_buffer(stream.get(), ARV_BUFFER(g_object_ref(buffer.get())));
  stream_underruns = stream_resent = 0;

  ticks_per_s = 0;
  std::uint32_t high = 0, low = 0;
  if (arv_device_read_register(device, kStampFrequencyHigh, &high, error.out()) &&
      arv_device_read_register(device, kStampFrequencyLow, &low, error.out()))
    ticks_per_s = std::uint64_t{high} << 32 | low;
  reading_gap_ns = kFirstReadingGapNs;
  next_reading_ns = 0;
  if (opened_before) {
    ids.restart();
    clock.reopened();
  }
  opened_before = true;
  readClock();

  arv_camera_start_acquisition(camera.get(), error.out());
  if (error.failed()) {
    failure = "does not start: " + error.text();
    count(Count::kOpenFailed);
    return close(true);
  }
  failure.clear();
  sent_since_open = any_stamp = false;
  broken_since_whole = 0;
  last_frame_ns = now();
}

void GigeCamera::Impl::close(bool answers) {
  if (stream != nullptr) {
    readStatistics();
    if (answers) {
      AravisError error;
      arv_camera_stop_acquisition(camera.get(), error.out());
    }
    stream.reset();  // ends its thread, and lets go of the buffers
  }
  if (camera != nullptr) {
    if (control_lost_handler != 0)
      g_signal_handler_disconnect(arv_camera_get_device(camera.get()), control_lost_handler);
    control_lost_handler = 0;
    camera.reset();
  }
}

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
  for (int i = 0; i < kReadingTries && uncertainty_ns > kCloseReadingNs; ++i) {
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

// Aravis notes when a frame's leader came, by the system's clock; `utc_ns` is now, by the vehicle's.
std::int64_t GigeCamera::Impl::firstPacketUtcNs(ArvBuffer* buffer, std::int64_t utc_ns) {
  const std::int64_t age =
      g_get_real_time() * kNsPerUs - static_cast<std::int64_t>(arv_buffer_get_system_timestamp(buffer));
  // Where the system's clock was set in between, the frame is as old as it can be told.
  return age >= 0 && age < kOldestFrameNs ? utc_ns - age : utc_ns;
}

void GigeCamera::Impl::take(ArvBuffer* buffer, FrameSink& sink) {
  if (arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_CLEARED) return;
  const std::int64_t utc_ns = now();
  const std::int64_t since_last_ns = utc_ns - last_whole_ns;
  last_frame_ns = utc_ns;
  sent_since_open = true;
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
  frame.utc_ns = clock.utcNs(frame.device_ns, firstPacketUtcNs(buffer, frame.arrival_utc_ns));
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

// Whether the camera must be opened again.
bool GigeCamera::Impl::lost() {
  if (control_lost.load()) {
    count(Count::kControlLost);
    failure = "no longer answers, or was started again";
    return true;
  }
  if (sent_since_open && now() - last_frame_ns > silenceNs()) {
    count(Count::kStalled);
    failure = "has sent nothing for " + std::to_string(silenceNs() / kNsPerMs) + " ms";
    return true;
  }
  return false;
}

bool GigeCamera::Impl::poll(int timeout_ms, FrameSink& sink) {
  if (camera == nullptr) {
    if (now() >= next_open_ns) open();
    if (camera == nullptr) {
      std::this_thread::sleep_for(std::chrono::milliseconds(std::max(timeout_ms, 0)));
      return false;
    }
  }
  const std::uint64_t wait_us = static_cast<std::uint64_t>(std::max(timeout_ms, 0)) * (kNsPerMs / kNsPerUs);
  for (ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream.get(), wait_us); buffer != nullptr;
       buffer = arv_stream_try_pop_buffer(stream.get())) {
    take(buffer, sink);
    arv_stream_push_buffer(stream.get(), buffer);
  }
  readStatistics();
  if (clock.hasReadings() && !clock.settled()) next_reading_ns = 0;
  if (lost()) {
    ++disconnects;
    close(false);
    next_open_ns = now();
    return false;
  }
  readClock();
  return true;
}

GigeCamera::GigeCamera(const CameraConfig& config, VehicleTime now, rt::MemoryLock lock)
    : impl_(std::make_unique<Impl>(config, std::move(now), lock)) {}
GigeCamera::~GigeCamera() = default;

bool GigeCamera::poll(int timeout_ms, FrameSink& sink) noexcept {
  return impl_->poll(timeout_ms, sink);
}

rt::SharedBlocks& GigeCamera::pool() noexcept {
  return impl_->blocks;
}

ImageView GigeCamera::view(const CameraFrame& frame) noexcept {
  const CameraConfig& c = impl_->config;
  return {.data = impl_->blocks.bytes(frame.block).data(),
          .width = c.width,
          .height = c.height,
          .stride = frameBytes(c.format.packing, static_cast<std::size_t>(c.width)),
          .format = c.format.format,
          .bits = c.format.bits};
}

DeviceHealth GigeCamera::health() const {
  DeviceHealth health;
  health.name = impl_->config.side == CameraSide::kLeft ? "camera_left" : "camera_right";
  for (const std::string_view name : kNames) health.counters.emplace_back(name, 0);
  updateHealth(health);
  return health;
}

void GigeCamera::updateHealth(DeviceHealth& health) const noexcept {
  health.open = impl_->camera != nullptr;
  health.last_data_ns = impl_->last_data_ns;
  health.samples = impl_->frames;
  health.disconnects = impl_->disconnects;
  for (std::size_t i = 0; i < kCounts && i < health.counters.size(); ++i)
    health.counters[i].second = impl_->counts[i];
  const auto set = [&](Count what, std::uint64_t value) {
    if (static_cast<std::size_t>(what) < health.counters.size())
      health.counters[static_cast<std::size_t>(what)].second = value;
  };
  set(Count::kClockResets, impl_->clock.resets());
  set(Count::kClockHeld, impl_->clock.clamped());
  set(Count::kPtpApart, impl_->clock.unsynchronised());
  set(Count::kPriorityRefused, impl_->priority_refused.load(std::memory_order_relaxed) ? 1 : 0);
}

const std::string& GigeCamera::lastFailure() const noexcept {
  return impl_->failure;
}
std::string GigeCamera::serial() const {
  return impl_->camera == nullptr ? "" : impl_->identity.serial;
}
std::string GigeCamera::address() const {
  return impl_->camera == nullptr ? "" : impl_->identity.address;
}
int GigeCamera::packetSize() const noexcept {
  return impl_->camera == nullptr ? 0 : impl_->identity.packet_size;
}
double GigeCamera::clockDrift() const noexcept {
  return impl_->clock.drift();
}

std::size_t GigeCamera::memoryBytes(const CameraConfig& config) {
  return config.pool_frames * frameBytes(config.format.packing, pixelsOf(config)) +
         config.buffers * bufferBytes(config);
}

}  // namespace fathom::io

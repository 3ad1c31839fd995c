#include "firmware_if/devices/camera/gige_camera.hpp"

#include <netinet/in.h>
#include <pthread.h>
#include <sched.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <thread>

#include "firmware_if/devices/camera/gige_camera_impl.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {

using namespace gige;  // NOLINT: declared in gige_camera_impl.hpp

namespace {

constexpr std::array<std::string_view, kCounts> kNames{
    "incomplete",   "timed_out",      "wrong_size",      "wrong_format",     "missed",
    "id_jumps",     "stale",          "pool_full",       "no_buffer",        "resent_packets",
    "clock_resets", "clock_held",     "clock_unsettled", "ptp_apart",        "control_lost",
    "stalled",      "no_first_frame", "open_failed",     "priority_refused", "receive_buffer_small"};

constexpr std::int64_t kRetryNs = kSecond_ns;  // between attempts to open
constexpr int kMostDescriptors = 4096;

// Aravis' own setting is limited to net.core.rmem_max, less than a frame; CAP_NET_ADMIN exceeds it. The
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
  // A whole frame's packets may arrive before the receiving thread is scheduled.
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
  if (config.trigger != CameraTrigger::kLine) first_frame.opened(last_frame_ns);
}

void GigeCamera::Impl::close(bool answers) {
  if (stream != nullptr) {
    readStatistics();
    if (answers) {
      AravisError error;
      arv_camera_stop_acquisition(camera.get(), error.out());
    }
    stream.reset();  // joins the receiving thread and releases its references to the buffers
  }
  if (camera != nullptr) {
    if (control_lost_handler != 0)
      g_signal_handler_disconnect(arv_camera_get_device(camera.get()), control_lost_handler);
    control_lost_handler = 0;
    camera.reset();
  }
}

// True when the camera must be opened again; counts the cause and sets `failure`.
bool GigeCamera::Impl::lost() {
  if (control_lost.load()) {
    count(Count::kControlLost);
    failure = "no longer answers, or was started again";
    return true;
  }
  if (sent_since_open && now() - last_frame_ns > silenceNs()) {
    count(Count::kStalled);
    failure = "has sent nothing for " + std::to_string(silenceNs() / kMillisecond_ns) + " ms";
    return true;
  }
  if (first_frame.overdue(now())) {
    count(Count::kNoFirstFrame);
    failure = "answers but sends no first frame";
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
  const std::uint64_t wait_us =
      static_cast<std::uint64_t>(std::max(timeout_ms, 0)) * (kMillisecond_ns / kMicrosecond_ns);
  for (ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream.get(), wait_us); buffer != nullptr;
       buffer = arv_stream_try_pop_buffer(stream.get())) {
    take(buffer, sink);
    arv_stream_push_buffer(stream.get(), buffer);
  }
  received.drained(systemNs(), now());
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

GigeCamera::GigeCamera(const CameraConfig& config, VehicleTime now, VehicleClockState clock,
                       rt::MemoryLock lock)
    : impl_(std::make_unique<Impl>(config, std::move(now), std::move(clock), lock)) {}
GigeCamera::~GigeCamera() = default;

bool GigeCamera::poll(int timeout_ms, FrameSink& sink) {
  return impl_->poll(timeout_ms, sink);
}

void GigeCamera::close() noexcept {
  if (impl_->camera != nullptr) ++impl_->disconnects;
  impl_->close(false);
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
  health.open = impl_->camera != nullptr;
  health.reason = impl_->failure;
  health.last_data_ns = impl_->last_data_ns;
  health.samples = impl_->frames;
  health.disconnects = impl_->disconnects;
  auto counts = impl_->counts;
  const auto set = [&](Count what, std::uint64_t value) { counts[static_cast<std::size_t>(what)] = value; };
  set(Count::kClockResets, impl_->clock.resets());
  set(Count::kClockHeld, impl_->clock.clamped());
  set(Count::kPtpApart, impl_->clock.unsynchronised());
  set(Count::kPriorityRefused, impl_->priority_refused.load(std::memory_order_relaxed) ? 1 : 0);
  for (std::size_t i = 0; i < kCounts; ++i) health.counters.add({kNames[i], counts[i]});
  return health;
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

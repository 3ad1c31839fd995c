#include "realtime/onboard/live/devices/device_threads.hpp"

#include <algorithm>
#include <array>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/kernel/fault_point.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "telemetry/wire/bundle.hpp"

namespace fathom::onboard {
namespace {

constexpr int kPollMs = 100;                        // a stop is noticed within this
constexpr std::int64_t kModemPoll_ns = 10'000'000;  // far below the time that a frame takes on the water

io::DeviceHealth withFailures(io::DeviceHealth health) {
  health.counters.emplace_back("poll_failures", 0);
  return health;
}

// Arrivals order the log and advance its time: an arrival that a device or the system misdated must not move
// that into the future or years back.
std::int64_t plausibleArrival(std::int64_t utc_ns, std::int64_t now_ns) noexcept {
  constexpr std::int64_t kMostAge_ns = 60'000'000'000;
  return std::clamp(utc_ns, now_ns - kMostAge_ns, now_ns);
}

// Into a health of withFailures().
template <class Device>
void refresh(const Device& device, const io::PollFence& fence, io::DeviceHealth& health) {
  device.updateHealth(health);
  fence.markFailure(health);
  health.counters.back().second = fence.failures();
}

// What is longer is no link frame.
static_assert(std::tuple_size_v<decltype(io::ModemFrame::bytes)> == telemetry::kMaxFrameBytes);

io::DeviceHealth modemHealth() {
  io::DeviceHealth health;
  health.name = "modem";
  return health;
}

}  // namespace

SampleThread::SampleThread(io::SampleSource& source, const Links& links, const rt::Clock& clock)
    : source_(source), links_(links), clock_(clock), health_(withFailures(source.health())) {}

void SampleThread::run(const std::atomic<bool>& stop) {
  while (!stop.load(std::memory_order_acquire)) {
    rt::faultPoint("samples");
    fence_.poll(source_, kPollMs, *this, clock_.monotonicNs());
    health_.update([&](io::DeviceHealth& health) { refresh(source_, fence_, health); });
    links_.heart->beat(clock_.monotonicNs());
  }
}

void SampleThread::sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept {
  (void)links_.inputs->push({plausibleArrival(arrival_utc_ns, clock_.utcNs()), sample});
}

void SampleThread::raw(std::int64_t arrival_utc_ns, std::string_view source,
                       std::span<const std::uint8_t> bytes) noexcept {
  if (links_.recorder != nullptr)
    (void)links_.recorder->offerRaw(links_.raw_lane, plausibleArrival(arrival_utc_ns, clock_.utcNs()), source,
                                    bytes);
}

CameraThread::CameraThread(io::CameraSource& camera, const Links& links, const rt::Clock& clock)
    : camera_(camera),
      links_(links),
      clock_(clock),
      name_(camera.health().name),
      health_(withFailures(camera.health())) {}

void CameraThread::run(const std::atomic<bool>& stop) {
  while (!stop.load(std::memory_order_acquire)) {
    rt::faultPoint(name_.data());
    fence_.poll(camera_, kPollMs, *this, clock_.monotonicNs());
    health_.update([&](io::DeviceHealth& health) { refresh(camera_, fence_, health); });
    links_.heart->beat(clock_.monotonicNs());
  }
}

void CameraThread::frame(const io::CameraFrame& frame) noexcept {
  // The recorder first: it writes the event when it has the pixels.
  if (links_.recorder != nullptr) {
    camera_.pool().retain(frame.block);
    (void)links_.recorder->offerImage(frame);
  }
  // The pixels before the stamp that speaks of them.
  links_.frames->lend(frame);
  (void)links_.stamps->push(
      {plausibleArrival(frame.arrival_utc_ns, clock_.utcNs()),
       SensorSample(ImageEvent{frame.utc_ns, frame.side, io::imageFileName(frame.utc_ns, frame.side),
                               frame.exposure_s})});
}

ModemThread::ModemThread(FramePort& modem, const Links& links, const rt::Clock& clock)
    : modem_(modem), links_(links), clock_(clock), health_(modemHealth()) {}

void ModemThread::receiveAll() noexcept {
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> bytes;
  while (const std::size_t size = modem_.receive(bytes)) {
    const std::span<const std::uint8_t> modem_frame(bytes.data(), size);
    const std::int64_t now = clock_.utcNs();
    counters_.received.fetch_add(1, std::memory_order_relaxed);
    counters_.last_received_ns.store(now, std::memory_order_relaxed);
    if (links_.recorder != nullptr)
      (void)links_.recorder->offerRaw(links_.raw_lane, now, "RAW_MODEM", modem_frame);
    telemetry::LinkFrames link_frames(modem_frame);
    while (const auto link_frame = link_frames.next()) {
      io::ModemFrame frame;
      if (link_frame->size() > frame.bytes.size()) continue;
      frame.size = static_cast<std::uint16_t>(link_frame->size());
      std::copy(link_frame->begin(), link_frame->end(), frame.bytes.begin());
      (void)links_.inputs->push({now, frame});
    }
  }
}

void ModemThread::run(const std::atomic<bool>& stop) {
  OutgoingFrame frame;
  while (!stop.load(std::memory_order_acquire)) {
    rt::faultPoint("modem");
    receiveAll();
    // From another process: anything, and for ever.
    for (std::size_t i = 0; i < ModemRing::capacity() && links_.outgoing->pop(frame); ++i) {
      if (frame.size == 0 || frame.size > frame.bytes.size()) continue;
      send(frame, false);
    }
    if (links_.own->next(clock_.utcNs(), frame)) {
      counters_.own.fetch_add(1, std::memory_order_relaxed);
      send(frame, true);
    }
    counters_.dropped.store(modem_.droppedFrames(), std::memory_order_relaxed);
    health_.update([&](io::DeviceHealth& health) {
      health.open = modem_.isOpen();
      health.reason = modem_.reason();
      health.last_data_ns = counters_.last_received_ns.load(std::memory_order_relaxed);
      health.samples = counters_.received.load(std::memory_order_relaxed);
    });
    links_.heart->beat(clock_.monotonicNs());
    rt::restFor(kModemPoll_ns);
  }
}

void ModemThread::send(const OutgoingFrame& frame, bool own) noexcept {
  const std::int64_t now = clock_.utcNs();
  const bool turn = links_.own->sent(now, frame.data(), own);
  (modem_.send(frame.data()) ? counters_.sent : counters_.refused).fetch_add(1, std::memory_order_relaxed);
  // The mapper may be behind: the start of the ship's turn to answer is noted here.
  telemetry::Version next = 0;
  if (turn && !own && links_.own->nextVersion(next))
    (void)links_.inputs->push({now, io::Mark{io::Mark::Kind::kSent, next}});
}

}  // namespace fathom::onboard

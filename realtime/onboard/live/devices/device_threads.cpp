#include "realtime/onboard/live/devices/device_threads.hpp"

#include <algorithm>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/kernel/fault_point.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::onboard {
namespace {

constexpr int kPollMs = 100;                        // a stop is noticed within this
constexpr std::int64_t kModemPoll_ns = 10'000'000;  // far below the time that a frame takes on the water

// Arrivals order the log and advance its time: an arrival that a device or the system misdated must not move
// that into the future or years back.
std::int64_t plausibleArrival(std::int64_t utc_ns, std::int64_t now_ns) noexcept {
  constexpr std::int64_t kMostAge_ns = 60'000'000'000;
  return std::clamp(utc_ns, now_ns - kMostAge_ns, now_ns);
}

// With what the guard saw.
template <class Device>
io::DeviceHealth healthOf(const Device& device, const io::PollGuard& guard) {
  io::DeviceHealth health = device.health();
  guard.markFailure(health);
  health.counters.add({"poll_failures", guard.failures()});
  return health;
}

// What is longer is no link frame.
static_assert(std::tuple_size_v<decltype(io::ModemFrame::bytes)> == telemetry::kMaxFrameBytes);

}  // namespace

void OwnStatus::set(const telemetry::Status& status, bool mapper) noexcept {
  known_.write({status, mapper ? 1U : 0U});
}

bool OwnStatus::nextVersion(telemetry::Version& version) const noexcept {
  version = next_.load(std::memory_order_relaxed);
  return any_.load(std::memory_order_acquire);
}

bool OwnStatus::next(std::int64_t now_ns, OutgoingFrame& frame) noexcept {
  Known known;
  if (last_ns_ == 0) last_ns_ = now_ns;
  if (!known_.read(known) || known.mapper != 0) return false;
  if (now_ns - last_ns_ < (own_turn_ ? config_.period_ns : config_.silent_ns)) return false;
  std::array<std::uint8_t, telemetry::kStatusBytes> payload{};
  const std::size_t bytes = telemetry::encodeStatus(known.status, payload);
  telemetry::FrameHeader header;
  header.identity = config_.identity;
  header.type = telemetry::MessageType::kStatus;
  // The ship may answer: after a status alone nothing else waits to be said.
  header.turn = true;
  const auto passed_over = own_turn_ ? std::uint16_t{0} : config_.passed_over;
  header.version = next_.load(std::memory_order_relaxed) + passed_over;
  const bool padded = config_.padded_bytes > 0;
  const std::span<std::uint8_t> out(frame.bytes);
  telemetry::ModemFrameWriter modem(padded ? out.first(config_.padded_bytes) : out, padded);
  modem.add(telemetry::encodeFrame(header, std::span(payload).first(bytes), modem.room(), config_.tag));
  frame.size = static_cast<std::uint16_t>(modem.finish());
  return true;
}

bool OwnStatus::sent(std::int64_t now_ns, std::span<const std::uint8_t> bytes, bool own) noexcept {
  last_ns_ = now_ns;
  own_turn_ = own;
  bool turn = false;
  telemetry::LinkFrames link_frames(bytes);
  while (const auto link_frame = link_frames.next()) {
    const telemetry::DecodedFrame frame = telemetry::peekFrame(*link_frame);
    if (frame.verdict != telemetry::FrameVerdict::kAccepted) continue;
    turn = turn || frame.header.turn;
    // A repair frame names another's number.
    if (frame.header.type == telemetry::MessageType::kRepair) continue;
    const telemetry::Version before = next_.load(std::memory_order_relaxed);
    next_.store(telemetry::versionNear(frame.header.sequence(), before) + 1, std::memory_order_relaxed);
    any_.store(true, std::memory_order_release);
  }
  return turn;
}

FrameLender::FrameLender(io::CameraSource& camera, FrameBroadcast& to,
                         const std::atomic<std::uint64_t>& floor, std::size_t most)
    : camera_(camera), to_(to), floor_(floor), most_(std::clamp<std::size_t>(most, 1, kMost)) {}

FrameLender::~FrameLender() {
  for (; count_ > 0; --count_, ++begin_) camera_.pool().release(loans_[begin_ % kMost].block);
}

void FrameLender::takeBack() noexcept {
  const std::uint64_t floor = floor_.load(std::memory_order_acquire);
  for (; count_ > 0 && loans_[begin_ % kMost].number < floor; --count_, ++begin_)
    camera_.pool().release(loans_[begin_ % kMost].block);
}

void FrameLender::lend(const io::CameraFrame& frame) noexcept {
  takeBack();
  if (count_ == most_) {
    refused_.fetch_add(1, std::memory_order_relaxed);
    camera_.pool().release(frame.block);
    return;
  }
  const ImageView view = camera_.view(frame);
  loans_[(begin_ + count_++) % kMost] = {frame.block, to_.next()};
  to_.push({frame, view.width, view.height, view.stride, view.format, view.bits});
}

SampleThread::SampleThread(io::SampleSource& source, const Links& links, const rt::Clock& clock)
    : source_(source), links_(links), clock_(clock), health_(healthOf(source, guard_)) {}

void SampleThread::run(const std::atomic<bool>& stop) {
  while (!stop.load(std::memory_order_acquire)) {
    rt::faultPoint("samples");
    guard_.poll(source_, kPollMs, *this, clock_.monotonicNs());
    health_.update(healthOf(source_, guard_));
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
      health_(healthOf(camera, guard_)) {}

void CameraThread::run(const std::atomic<bool>& stop) {
  while (!stop.load(std::memory_order_acquire)) {
    rt::faultPoint(name_.data());
    guard_.poll(camera_, kPollMs, *this, clock_.monotonicNs());
    health_.update(healthOf(camera_, guard_));
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
    : modem_(modem), links_(links), clock_(clock), health_({.name = "modem"}) {}

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
  io::DeviceHealth health = health_.read();
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
    health.open = modem_.isOpen();
    health.reason = modem_.reason();
    health.last_data_ns = counters_.last_received_ns.load(std::memory_order_relaxed);
    health.samples = counters_.received.load(std::memory_order_relaxed);
    health_.update(health);
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

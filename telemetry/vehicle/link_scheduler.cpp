#include "telemetry/vehicle/link_scheduler.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "realtime/base/units.hpp"
#include "telemetry/vehicle/link_scheduler_impl.hpp"

namespace fathom::telemetry {
namespace {

// The bucket holds two frames, or a second's worth, so that a late caller still gets the whole rate.
constexpr std::size_t kBucketFrames = 2;
constexpr double kBucketSeconds = 1;
constexpr std::size_t kDownlinkBytes = 48;  // of a usual downlink frame
constexpr double kTurnMargin_s = 0.5;       // for the ship to answer
constexpr double kRepeatGoal = 0.95;        // probability that a block has arrived after its repeats
constexpr double kRepeatFrames = 2;         // between repeats, longer than a short burst of loss
constexpr int kMostRepeats = 200;           // of a block that stays unacknowledged
constexpr double kCarousel_s = 60;          // between two repeats of the carousel
constexpr double kListenShare = 0.2;        // of the time, by rule
constexpr int kMaxTurnFrames = static_cast<int>(Acknowledgement::kMaxReach) / 2;
constexpr int kMaxMapColourBits = 6;
constexpr double kMaxPreambleBits =
    5e5;  // that the time of a preamble would carry: the token bucket counts them

std::size_t largestModemFrame(const LinkSchedulerConfig& c) {
  return static_cast<std::size_t>(c.modem_bytes > 0 ? c.modem_bytes : c.frame_bytes);
}

// Bits of the rate that a modem frame takes; its preamble counts as the bits that its time would carry.
std::size_t linkBits(const LinkSchedulerConfig& c, std::size_t bytes) {
  return bytes * 8 + static_cast<std::size_t>(c.preamble_s * c.rate_bps);
}

double airSeconds(const LinkSchedulerConfig& c, std::size_t bytes) {
  return c.preamble_s + static_cast<double>(bytes) * 8 / c.rate_bps;
}

// Rate without preambles, when every modem frame is full [bit/s].
double usableRate(const LinkSchedulerConfig& c) {
  const std::size_t bytes = largestModemFrame(c);
  return c.rate_bps * c.duty * static_cast<double>(bytes * 8) / static_cast<double>(linkBits(c, bytes));
}

// Least period of a status [s]: of kPaddedFrames padded frames one may carry a status alone.
double leastPeriod(const LinkSchedulerConfig& c) {
  constexpr double kPaddedFrames = 4;
  return c.padded ? kPaddedFrames * airSeconds(c, largestModemFrame(c)) : 0;
}

// Link frames of one modem frame are lost together.
double expectedBurst(const LinkSchedulerConfig& c) {
  const int together = c.modem_bytes / (c.frame_bytes + static_cast<int>(kBundleShareBytes));
  return together > 1 ? together * std::max(c.mean_burst, 1 / (1 - c.loss_rate)) : c.mean_burst;
}

double listenSeconds(const LinkSchedulerConfig& c) {
  if (c.listen_s > 0) return c.listen_s;
  // The ship pads its answer as the vehicle does.
  const std::size_t bytes =
      c.padded ? largestModemFrame(c) : std::min(static_cast<std::size_t>(c.frame_bytes), kDownlinkBytes);
  return 2 * c.max_delay_s + airSeconds(c, bytes) + kTurnMargin_s;
}

double listenEvery(const LinkSchedulerConfig& c) {
  if (!c.half_duplex) return 0;
  if (c.listen_every_s > 0) return c.listen_every_s;
  return listenSeconds(c) / kListenShare;
}

}  // namespace

std::size_t linkBucketBits(const LinkSchedulerConfig& config) {
  return std::max(kBucketFrames * linkBits(config, largestModemFrame(config)),
                  static_cast<std::size_t>(kBucketSeconds * config.rate_bps));
}

void LinkSchedulerConfig::validate() const {
  requireBounds(rate_bps >= 10 && rate_bps <= 1e6, "rate_bps is outside 10 to 1e6 bit/s");
  requireBounds(
      frame_bytes >= static_cast<int>(kMinFrameBytes) && frame_bytes <= static_cast<int>(kMaxFrameBytes),
      "frame_bytes is outside 32 to 256");
  requireBounds(modem_bytes == 0 ||
                    (modem_bytes >= static_cast<int>(kMinModemBytes) &&
                     modem_bytes <= static_cast<int>(kMaxModemBytes) &&
                     modem_bytes >= frame_bytes + static_cast<int>(kBundleHeadBytes + kBundleShareBytes)),
                "modem_bytes is neither 0 nor 64 to 2048 and frame_bytes + 2 at least");
  requireBounds(!padded || modem_bytes > 0, "padded needs modem_bytes");
  requireBounds(preamble_s >= 0 && preamble_s <= 5, "preamble_s is outside 0 to 5 s");
  requireBounds(preamble_s * rate_bps <= kMaxPreambleBits, "preamble_s is too long at this rate_bps");
  requireBounds(duty >= 0.05 && duty <= 1, "duty is outside 0.05 to 1");
  requireBounds(loss_rate >= 0 && loss_rate <= 0.9, "loss_rate is outside 0 to 0.9");
  requireBounds(mean_burst >= 0 && mean_burst <= 100, "mean_burst is outside 0 to 100 frames");
  requireBounds(listen_every_s >= 0 && listen_every_s <= 3600, "listen_every_s is outside 0 to 3600 s");
  requireBounds(listen_every_frames >= 0 && listen_every_frames <= 256,
                "listen_every_frames is outside 0 to 256");
  requireBounds(listen_s >= 0 && listen_s <= 60, "listen_s is outside 0 to 60 s");
  requireBounds(max_delay_s >= 0 && max_delay_s <= 30, "max_delay_s is outside 0 to 30 s");
  requireBounds(colour_bits >= 0 && colour_bits <= kMaxMapColourBits, "colour_bits is outside 0 to 6");
  housekeeping.validate();
  blocks.validate();
}

LinkScheduler::Impl::Impl(const LinkSchedulerConfig& c)
    : config((c.validate(), c)),
      bucket(c.rate_bps * c.duty, linkBucketBits(c), linkBits(c, largestModemFrame(c))),
      queue(c.blocks),
      sent(listenSeconds(c), c.loss_rate, expectedBurst(c), c.first),
      housekeeping(c.housekeeping, c.frame_bytes, c.loss_rate),
      turns(listenEvery(c), listenSeconds(c)),
      lasting(c.rate_bps) {
  if (config.listen_every_frames == 0) config.listen_every_frames = kMaxTurnFrames;
  housekeeping.plan(usableRate(c), leastPeriod(c));
}

void LinkScheduler::Impl::applyRate() {
  bucket = TokenBucket(config.rate_bps * config.duty, linkBucketBits(config),
                       linkBits(config, largestModemFrame(config)));
  bucket.advance(now);
  housekeeping.plan(usableRate(config), leastPeriod(config));
  turns.setIntervals(listenEvery(config), listenSeconds(config));
}

std::size_t LinkScheduler::Impl::repairFrame() {
  const RepairEncoder::Row row = repair.next(std::span(payload).first(payloadRoom()));
  if (row.bytes == 0) return 0;
  type = MessageType::kRepair;
  frame_version = row.first;
  frame_group = row.group;
  ++counters.repair_frames;
  return row.bytes;
}

std::size_t LinkScheduler::Impl::mapPacket(int sendings, double after_s) {
  queue.repeat(sendings, after_s);
  // Without acknowledgements a packet leaves room for the head of the frame that may repair it; the carousel
  // needs none.
  const std::size_t room = payloadRoom() - (blind() && !again ? kRepairMargin : 0);
  const auto out = std::span(payload).first(room);
  // A block takes a byte at the very least.
  while (queue.gather(now, room, batch)) {
    const std::span<const MapBlock> blocks = std::span(batch.blocks).first(batch.size);
    // Blocks that do not fit are sent without colour, and then of a block too long for a frame as many nodes
    // as fit within the error. A repeat is sent whole, as it must remove no nodes that the ship may have.
    MapPacketEncoder::Result result =
        encoder.encode(blocks, {batch.max_error, config.colour_bits}, out, decoded);
    if (result.bytes == 0 && isRest()) return 0;  // it may fit the next frame
    if (result.bytes == 0) {
      result = encoder.encode(blocks, {batch.max_error, 0, !batch.repeats}, out, decoded);
      if (result.bytes > 0) ++counters.reduced_packets;
    }
    if (result.bytes == 0) {
      queue.unsendable(batch);
      continue;
    }
    batch_sent = result.blocks;
    queue.sent(batch, result.blocks, decoded, sent.next());
    type = MessageType::kMapPacket;
    ++counters.map_frames;
    counters.map_bytes += result.bytes + kFrameOverhead;
    return result.bytes;
  }
  return 0;
}

// When only unacknowledged frames are left, sends the oldest blocks again: the ship probably lacks them, and
// a frame is needed to give the turn.
std::size_t LinkScheduler::Impl::probe() {
  if (!turns.everAnswered() || !turns.due(std::max(busy_until, now), true) || !queue.expireOldest()) return 0;
  return mapPacket(1, 0);
}

// Repeats everything that was sent in spare time while no answers come: what the ship lacks is unknown, and
// it may have come late.
std::size_t LinkScheduler::Impl::carousel() {
  again = !turns.answered();
  return again ? mapPacket(kMostRepeats, kCarousel_s) : 0;
}

// The payload of the frame that should go now, 0 for none; sets type, frame_version and frame_group.
std::size_t LinkScheduler::Impl::choose() {
  batch_sent = 0;
  again = false;
  frame_version = sent.next();
  frame_group = 0;
  if (const auto rate = lasting.lapse(now)) setRate(*rate);
  housekeeping.setReport({0, lasting.paused(), config.rate_bps, lasting.outcomes()}, sent.loss());
  if (const std::size_t size =
          housekeeping.next(now, frame_version, std::span(payload).first(payloadRoom()), type)) {
    ++(type == MessageType::kStatus        ? counters.status_frames
       : type == MessageType::kReport      ? counters.report_frames
       : type == MessageType::kMissionInfo ? counters.info_frames
                                           : counters.track_frames);
    return size;
  }
  if (!blind()) repair.clear();
  if (repair.due() && !isRest())
    if (const std::size_t size = repairFrame()) return size;
  if (lasting.paused()) {
    const std::size_t size = housekeeping.spareStatus(now, payload);
    type = MessageType::kStatus;
    counters.status_frames += size > 0 ? 1 : 0;
    return size;
  }
  // Spare room takes unacknowledged blocks; without acknowledgements, repair frames do that better.
  const double frame_s = static_cast<double>(config.frame_bytes) * 8 / config.rate_bps;
  const int sendings = turns.answered() ? repeatsForGoal(sent.loss(), kRepeatGoal) : 1;
  if (const std::size_t size = mapPacket(sendings, std::max(kRepeatFrames * frame_s, 1.0))) return size;
  if (const std::size_t size =
          housekeeping.spareTrack(frame_version, std::span(payload).first(payloadRoom()))) {
    type = MessageType::kTrack;
    ++counters.track_frames;
    return size;
  }
  if (isRest()) return carousel();
  if (const std::size_t size = housekeeping.spareStatus(now, payload)) {
    type = MessageType::kStatus;
    ++counters.status_frames;
    return size;
  }
  if (repair.open()) repair.close(sent.loss(), sent.burst());
  if (const std::size_t size = repairFrame()) return size;
  if (const std::size_t size = probe()) return size;
  return carousel();
}

// Whether the present frame, which ends at left_ns, is the last before the vehicle listens.
bool LinkScheduler::Impl::turnAfter(std::int64_t left_ns) {
  // The vehicle waits for an answer to a report.
  const bool idle =
      type == MessageType::kReport ||
      (!repair.pending() && (lasting.paused() || !queue.ready(now)) && queue.census().in_flight > 0);
  return turns.due(left_ns, idle) ||
         (turns.enabled() && turns.answered() && frames_since_turn >= config.listen_every_frames);
}

LinkScheduler::LinkScheduler(const LinkSchedulerConfig& config) : impl_(std::make_unique<Impl>(config)) {}
LinkScheduler::~LinkScheduler() = default;

void LinkScheduler::setStatus(const Status& status) {
  impl_->housekeeping.setStatus(status);
}

void LinkScheduler::setMissionInfo(const MissionInfo& info) {
  impl_->housekeeping.setMissionInfo(info);
}

void LinkScheduler::offer(const HeightTile& tile, std::int64_t now_ns, double max_error) {
  impl_->queue.offer(tile, max_error > 0 ? max_error : impl_->config.blocks.max_error, now_ns);
}

void LinkScheduler::onEvicted(BlockQueue::OnEvicted on_evicted) {
  impl_->queue.onEvicted(std::move(on_evicted));
}

bool LinkScheduler::hasRoom() const {
  return impl_->queue.hasRoom();
}

bool LinkScheduler::spare() const {
  // One modem frame's worth of blocks, so that no frame leaves half empty.
  constexpr int kLeastBlockBytes = 16;
  return !impl_->turns.answered() &&
         impl_->queue.census().waiting <= impl_->config.modem_bytes / kLeastBlockBytes;
}

void LinkScheduler::eachHeld(
    const std::function<void(const BlockKey&, Version, Version, const MapBlock&)>& visit) const {
  impl_->queue.eachHeld(visit);
}

bool LinkScheduler::Impl::addFrame(std::size_t payload_bytes, std::int64_t begin_ns,
                                   ModemFrameWriter& modem) {
  busy_until =
      begin_ns + rt::nanoseconds(airSeconds(config, modem.bytesWith(payload_bytes + kFrameOverhead)));
  const auto body = std::span<const std::uint8_t>(payload).first(payload_bytes);
  if (type != MessageType::kRepair) {
    if (blind() && !again)
      repair.source(sent.next(), body, type == MessageType::kMapPacket, sent.loss(), sent.burst());
    sent.add(busy_until, std::span(batch.refs).first(batch_sent));
  }
  ++frames_since_turn;
  const bool turn = turnAfter(busy_until);
  if (turn) {
    turns.begin(now, busy_until);
    frames_since_turn = 0;
    ++counters.turns;
  }
  modem.add(
      encodeFrame({config.identity, frame_version, type, turn}, body, modem.room(), config.tag, frame_group));
  ++counters.frames;
  return turn;
}

std::size_t LinkScheduler::nextFrame(std::int64_t now_ns, std::span<std::uint8_t> out) {
  Impl& s = *impl_;
  s.now = std::max(s.now, now_ns);
  s.bucket.advance(s.now);
  const std::size_t most = largestModemFrame(s.config);
  if (out.size() < most || s.turns.listening(s.now) || !s.bucket.has(linkBits(s.config, most))) return 0;
  // The modem holds at most one frame besides the one being sent, so that turns are given when due.
  const double longest_s = std::max(airSeconds(s.config, most), kBucketSeconds);
  if (s.busy_until > s.now + rt::nanoseconds(longest_s)) return 0;

  ModemFrameWriter modem(out.first(most), s.config.padded);
  const std::int64_t begin_ns = std::max(s.busy_until, s.now);
  const Version first = s.sent.next();
  bool more = true;
  // The rest of a bundle takes a shorter frame.
  while (more && modem.room().size() >= kMinFrameBytes) {
    s.frame_room = std::min(modem.room().size(), static_cast<std::size_t>(s.config.frame_bytes));
    const std::size_t payload_bytes = s.choose();
    more = payload_bytes > 0 && !s.addFrame(payload_bytes, begin_ns, modem) && s.config.modem_bytes > 0;
  }
  const std::size_t size = modem.finish();
  if (size == 0) return 0;
  s.sent.leftTogether(first, s.busy_until);
  s.bucket.take(linkBits(s.config, size));
  s.counters.bytes += size;
  return size;
}

void LinkScheduler::noteRestart() {
  Impl& s = *impl_;
  // The number of the shortest frames in the seconds that a log may lack, and a few more.
  constexpr double kLacking_s = 2, kFew = 4;
  const double bytes =
      kLacking_s * s.config.rate_bps * s.config.duty / 8 + static_cast<double>(s.config.modem_bytes);
  const double frames = kFew + bytes / kMinFrameBytes;
  s.passOver(static_cast<Version>(std::min(frames, SentFrames::kFrames / 2.0)));
  s.queue.noteUnknownFrames();
}

void LinkScheduler::noteSent(Version next, std::int64_t now_ns) {
  if (next < SentFrames::kFirst) next = versionNear(static_cast<std::uint16_t>(next), impl_->sent.next());
  if (next > impl_->sent.next()) impl_->passOver(next - impl_->sent.next());
  if (next == impl_->sent.next()) impl_->turns.left(now_ns);
}

void LinkScheduler::Impl::passOver(Version numbers) {
  if (repair.open()) repair.close(sent.loss(), sent.burst());
  sent.skip(numbers);
}

bool LinkScheduler::drained() const {
  const Impl& s = *impl_;
  const BlockQueue::Census census = s.queue.census(repeatsForGoal(s.sent.loss(), kRepeatGoal));
  return census.waiting == 0 && s.detail_count == 0 && !s.repair.pending() &&
         !(s.blind() && s.repair.open()) && (s.turns.answered() ? census.in_flight : census.in_repeat) == 0;
}

LinkScheduler::Counters LinkScheduler::counters() const {
  const Impl& s = *impl_;
  Counters c = s.counters;
  const BlockQueue::Census census = s.queue.census();
  c.acknowledgements = s.sent.counters().acknowledgements;
  c.acknowledgements_foreign = s.sent.counters().foreign;
  c.frames_arrived = s.sent.counters().arrived;
  c.frames_lost = s.sent.counters().lost;
  c.blocks = s.queue.counters();
  c.squares_held = census.squares;
  c.blocks_waiting = census.waiting;
  c.blocks_in_flight = census.in_flight;
  c.loss = s.sent.loss();
  c.periods_stretched = s.housekeeping.stretch();
  c.rate_bps = s.config.rate_bps;
  c.paused = s.lasting.paused();
  return c;
}

std::size_t LinkScheduler::memoryBytes() const {
  const Impl& s = *impl_;
  return sizeof(Impl) + s.queue.memoryBytes() + s.sent.memoryBytes() + s.repair.memoryBytes();
}

}  // namespace fathom::telemetry

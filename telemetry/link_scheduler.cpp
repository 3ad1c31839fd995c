#include "telemetry/link_scheduler.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "telemetry/tile_fragments.hpp"
#include "telemetry/tile_queue.hpp"
#include "telemetry/token_bucket.hpp"
#include "telemetry/track.hpp"

namespace fathom::telemetry {
namespace {

// A caller that asks late still gets the whole rate: the bucket holds two frames, or a second's worth.
constexpr int kBucketFrames = 2;
constexpr double kBucketSeconds = 1;
constexpr unsigned kTrackStepBits =
    40;  // of a usual older track point: 10 for time, 3 x 10 for up to 51 m of way
constexpr unsigned kTrackHeadBits = 100;

std::int64_t nanoseconds(double seconds) {
  return std::llround(seconds * 1e9);
}

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

bool isStride(int s) {
  return s == 1 || s == 2 || s == 4 || s == 8;
}

// When something periodic is due.
struct Timer {
  std::int64_t period_ns = 0;
  std::int64_t next_ns = 0;
  [[nodiscard]] bool due(std::int64_t now_ns) const { return now_ns >= next_ns; }
  void done(std::int64_t now_ns) { next_ns = now_ns + period_ns; }
};

}  // namespace

int repeatsForGoal(double loss, double goal, int fragments) {
  if (loss <= 0) return 1;
  const double each = std::pow(goal, 1.0 / std::max(fragments, 1));
  return std::max(1, static_cast<int>(std::ceil(std::log1p(-each) / std::log(loss) - 1e-9)));
}

std::size_t linkBucketBits(const LinkSchedulerConfig& config) {
  return std::max(static_cast<std::size_t>(kBucketFrames * config.frame_bytes) * 8,
                  static_cast<std::size_t>(kBucketSeconds * config.rate_bps));
}

void LinkSchedulerConfig::validate() const {
  require(rate_bps >= 10 && rate_bps <= 1e6, "rate_bps is outside 10 to 1e6 bit/s");
  require(frame_bytes >= static_cast<int>(kMinFrameBytes) && frame_bytes <= static_cast<int>(kMaxFrameBytes),
          "frame_bytes is outside 32 to 256");
  require(loss_rate >= 0 && loss_rate <= 0.9, "loss_rate is outside 0 to 0.9");
  require(delivery_goal >= 0.5 && delivery_goal <= 0.99999, "delivery_goal is outside 0.5 to 0.99999");
  require(housekeeping_share >= 0.01 && housekeeping_share <= 1, "housekeeping_share is outside 0.01 to 1");
  require(status_period_s >= 0.1 && status_period_s <= 3600, "status_period_s is outside 0.1 to 3600 s");
  require(mission_info_period_s >= 1 && mission_info_period_s <= 36000,
          "mission_info_period_s is outside 1 to 36000 s");
  require(track_interval_s >= 0.1 && track_interval_s <= 60, "track_interval_s is outside 0.1 to 60 s");
  require(track_points >= 2 && track_points <= static_cast<int>(kMaxTrackPoints),
          "track_points is outside 2 to 63");
  require(isStride(coarse_stride) && isStride(fine_stride) && fine_stride <= coarse_stride,
          "coarse_stride and fine_stride are 1, 2, 4 or 8, fine_stride not the greater");
  require(update_depth > 0 && update_depth <= 100, "update_depth is outside 0 to 100 m");
  require(settle_s >= 0 && settle_s <= 600, "settle_s is outside 0 to 600 s");
  require(max_tiles >= 1 && max_tiles <= 1'000'000, "max_tiles is outside 1 to 1000000");
  codec.validate();
}

struct LinkScheduler::Impl {
  explicit Impl(const LinkSchedulerConfig& c);
  void sampleTrack(const Status& status);
  void planHousekeeping();
  std::size_t housekeeping(std::int64_t now_ns);
  std::size_t tileFragment(std::int64_t now_ns);
  bool startTile(std::int64_t now_ns);
  [[nodiscard]] std::size_t payloadRoom() const {
    return static_cast<std::size_t>(config.frame_bytes) - kFrameOverhead;
  }

  LinkSchedulerConfig config;
  TokenBucket bucket;
  TileQueue queue;
  Counters counters;
  std::uint16_t sequence = 0;
  std::int64_t now = 0;

  std::optional<Status> status;
  std::optional<MissionInfo> info;
  std::array<TrackPoint, kMaxTrackPoints> track{};  // oldest first
  std::size_t track_size = 0;
  std::size_t track_capacity = 0;
  std::int64_t track_interval_ns = 0;
  Timer status_timer, info_timer, track_timer;

  // The tile on its way.
  TileId tile_id;
  std::array<std::uint8_t, kMaxTileBytes> tile_bytes{};
  std::size_t tile_size = 0;
  int next_fragment = 0;

  MessageType type = MessageType::kStatus;
  std::array<std::uint8_t, kMaxFrameBytes> payload{};
};

LinkScheduler::Impl::Impl(const LinkSchedulerConfig& c)
    : config((c.validate(), c)),
      bucket(c.rate_bps, linkBucketBits(c), static_cast<std::size_t>(c.frame_bytes) * 8),
      queue({c.max_tiles, c.coarse_stride, c.fine_stride, c.update_depth, c.settle_s, c.loss_rate,
             c.delivery_goal}) {
  planHousekeeping();
}

// Periods as configured, or all stretched by one factor so that housekeeping keeps to its share of the rate.
void LinkScheduler::Impl::planHousekeeping() {
  constexpr double status_bytes = kStatusBytes + kFrameOverhead;
  const std::size_t room_bits = payloadRoom() * 8;
  const std::size_t fit = 1 + (room_bits - std::min<std::size_t>(room_bits, kTrackHeadBits)) / kTrackStepBits;
  const std::size_t points = std::min(fit, static_cast<std::size_t>(config.track_points));
  const double track_bytes = static_cast<double>(kFrameOverhead) +
                             (kTrackHeadBits + static_cast<double>(points - 1) * kTrackStepBits) / 8;
  const double info_bytes = std::min<double>(config.frame_bytes, kFrameOverhead + kMaxNameBytes);
  // Every point must travel so often that it arrives; twice at least, for a loss rate that was set too low.
  const int repeats = std::max(2, repeatsForGoal(config.loss_rate, config.delivery_goal, 1));
  const double track_period =
      std::max(1.0, std::floor(static_cast<double>(points) / repeats)) * config.track_interval_s;

  const double bits_per_s = 8 * (status_bytes / config.status_period_s + track_bytes / track_period +
                                 info_bytes / config.mission_info_period_s);
  const double stretch = std::max(1.0, bits_per_s / (config.housekeeping_share * config.rate_bps));
  counters.periods_stretched = stretch;
  track_capacity = points;
  track_interval_ns = nanoseconds(stretch * config.track_interval_s);
  status_timer.period_ns = nanoseconds(stretch * config.status_period_s);
  track_timer.period_ns = nanoseconds(stretch * track_period);
  info_timer.period_ns = nanoseconds(stretch * config.mission_info_period_s);
}

void LinkScheduler::Impl::sampleTrack(const Status& s) {
  if (track_size > 0 && s.utc_ns < track[track_size - 1].utc_ns) track_size = 0;  // the clock was set back
  if (track_size > 0 && s.utc_ns - track[track_size - 1].utc_ns < track_interval_ns) return;
  if (track_size == track_capacity) {
    std::move(track.begin() + 1, track.begin() + static_cast<std::ptrdiff_t>(track_size), track.begin());
    --track_size;
  }
  track[track_size++] = {s.utc_ns, s.north, s.east, s.depth};
}

// Payload of the housekeeping message that is due, 0 for none.
std::size_t LinkScheduler::Impl::housekeeping(std::int64_t now_ns) {
  const std::span<std::uint8_t> out = std::span(payload).first(payloadRoom());
  if (status && status_timer.due(now_ns)) {
    status_timer.done(now_ns);
    type = MessageType::kStatus;
    ++counters.status_frames;
    return encodeStatus(*status, out);
  }
  if (info && info_timer.due(now_ns)) {
    info_timer.done(now_ns);
    type = MessageType::kMissionInfo;
    ++counters.info_frames;
    return encodeMissionInfo(*info, out);
  }
  if (track_size > 0 && track_timer.due(now_ns)) {
    track_timer.done(now_ns);
    type = MessageType::kTrack;
    ++counters.track_frames;
    return encodeTrack(std::span(track).first(track_size), out);
  }
  return 0;
}

// Encodes the next tile into tile_bytes; false when no tile is worth sending.
bool LinkScheduler::Impl::startTile(std::int64_t now_ns) {
  for (;;) {
    TileQueue::Choice choice = queue.choose(now_ns);
    if (choice.slot < 0) return false;
    const HeightTile& tile = queue.tile(choice.slot);
    constexpr int kCoarsest = 8;
    tile_size = 0;
    int stride = choice.stride;
    for (; stride <= kCoarsest;
         stride *= 2) {  // coarser when the fragments would be too many for small frames
      tile_size = makeTileId(tile, stride, tile_id) ? encodeTile(tile, stride, config.codec, tile_bytes) : 0;
      if (tile_size > 0 &&
          fragmentCount(tile_size, static_cast<std::size_t>(config.frame_bytes)) <= kMaxFragments)
        break;
      tile_size = 0;
    }
    if (tile_size == 0) {
      queue.unsendable(choice);
      continue;
    }
    queue.sent(choice, fragmentCount(tile_size, static_cast<std::size_t>(config.frame_bytes)));
    next_fragment = 0;
    return true;
  }
}

std::size_t LinkScheduler::Impl::tileFragment(std::int64_t now_ns) {
  if (tile_size == 0 && !startTile(now_ns)) return 0;
  const std::span<const std::uint8_t> bytes = std::span(tile_bytes).first(tile_size);
  const auto frame_bytes = static_cast<std::size_t>(config.frame_bytes);
  const std::size_t size = encodeFragment(tile_id, bytes, next_fragment, frame_bytes, payload);
  type = MessageType::kTileFragment;
  ++counters.tile_frames;
  counters.tile_bytes += size + kFrameOverhead;
  if (++next_fragment == fragmentCount(tile_size, frame_bytes)) {
    tile_size = 0;
    ++counters.tiles_sent;
  }
  return size;
}

LinkScheduler::LinkScheduler(const LinkSchedulerConfig& config) : impl_(std::make_unique<Impl>(config)) {}
LinkScheduler::~LinkScheduler() = default;

void LinkScheduler::setStatus(const Status& status) {
  impl_->status = status;
  impl_->sampleTrack(status);
}

void LinkScheduler::setMissionInfo(const MissionInfo& info) {
  impl_->info = info;
}

void LinkScheduler::offer(const HeightTile& tile) {
  impl_->queue.offer(tile, impl_->now);
}

std::size_t LinkScheduler::nextFrame(std::int64_t now_ns, std::span<std::uint8_t> out) {
  Impl& s = *impl_;
  s.now = std::max(s.now, now_ns);
  s.bucket.advance(s.now);
  const auto frame_bytes = static_cast<std::size_t>(s.config.frame_bytes);
  if (out.size() < frame_bytes || !s.bucket.has(frame_bytes * 8)) return 0;
  std::size_t payload_bytes = s.housekeeping(s.now);
  if (payload_bytes == 0) payload_bytes = s.tileFragment(s.now);
  if (payload_bytes == 0) return 0;
  const std::size_t size = encodeFrame({s.config.identity, s.sequence, s.type},
                                       std::span<const std::uint8_t>(s.payload).first(payload_bytes), out);
  ++s.sequence;
  s.bucket.take(size * 8);
  ++s.counters.frames;
  s.counters.bytes += size;
  return size;
}

LinkScheduler::Counters LinkScheduler::counters() const {
  Counters c = impl_->counters;
  c.tiles_offered = impl_->queue.counters().offered;
  c.tiles_evicted = impl_->queue.counters().evicted;
  c.tiles_unsendable = impl_->queue.counters().unsendable;
  c.tiles_held = impl_->queue.held();
  c.tiles_waiting = impl_->queue.waiting();
  return c;
}

std::size_t LinkScheduler::memoryBytes() const {
  return sizeof(Impl) + impl_->queue.memoryBytes();
}

}  // namespace fathom::telemetry

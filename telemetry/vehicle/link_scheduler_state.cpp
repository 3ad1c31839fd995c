// Saved state of the vehicle's end of the link: what was sent and acknowledged, what waits, which end has the
// turn. A loaded link continues with the frames that the saved one would have sent.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "realtime/base/bytes/state_archive.hpp"
#include "telemetry/vehicle/link_scheduler_impl.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::uint32_t kLinkTag = rt::stateTag("LINK"), kLinkVersion = 3;
constexpr double kFarthest = 1e6;  // of a square from nav's origin [m]
constexpr int kMostSendings = 1000;

// A number that is stored as another type.
template <typename Archive, typename Number>
void exchangeCount(Archive& archive, Number& number, std::size_t most) {
  std::uint64_t value = number;
  archive(value);
  archive.require(value <= most, "more than there is room for");
  if constexpr (Archive::kLoading)
    if (archive.ok()) number = static_cast<Number>(value);
}

template <typename Archive, typename Ref>
void exchangeRef(Archive& archive, Ref& ref) {
  archive(ref.square, ref.block);
}

template <typename Archive, typename S>
void exchangeStatus(Archive& archive, S& s) {
  archive.instants(s.utc_ns);
  archive(s.north, s.east, s.depth, s.roll, s.pitch, s.heading, s.altitude, s.speed, s.position_sigma,
          s.battery, s.pairs_seen, s.pairs_dropped, s.map_area, s.mission_progress, s.health, s.late_cycles,
          s.shed_work, s.pool_refusals);
}

}  // namespace

template <typename Archive, typename Self>
void BlockQueue::exchangeBlock(Archive& archive, Self& b) {
  archive(b.content.seen, b.content.sigma, b.content.depth, b.content.colour, b.held, b.held_seen,
          b.held_error);
  archive.enumeration(b.state, State::kLost);
  archive(b.wanted, b.blocked, b.orphan, b.moved, b.spread, b.first, b.last, b.has, b.flying, b.sendings);
  archive.require(b.first <= b.last && (b.has == 0 || (b.has >= b.first && b.has <= b.last)),
                  "frames that cannot be");
  archive.instants(b.sent_ns, b.changed_ns, b.since_ns);
}

template <typename Archive, typename Self>
void BlockQueue::exchange(Archive& archive, Self& self) {
  archive(self.order_, self.oldest_, self.sendings_, self.counters_);
  archive.instants(self.repeat_after_ns_, self.now_ns_);
  archive.require(self.sendings_ >= 1 && self.sendings_ <= kMostSendings, "sendings that cannot be");
  for (auto& s : self.squares_) {
    archive(s.used);
    if (!s.used) continue;
    archive(s.spacing, s.north, s.east, s.max_error, s.order);
    for (auto& b : s.blocks) exchangeBlock(archive, b);
  }
  std::size_t remembered = self.remembered_.size();
  exchangeCount(archive, remembered, self.remembered_.capacity());
  if constexpr (Archive::kLoading) {
    if (!archive.ok()) return;
    self.remembered_.resize(remembered);
  }
  for (auto& r : self.remembered_) archive(r.spacing, r.north, r.east, r.has, r.version);
  archive.require(std::is_sorted(self.remembered_.begin(), self.remembered_.end()), "squares in no order");
}

void BlockQueue::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool BlockQueue::isValid(const Square& s) const {
  const double side = spacingOf(s.spacing) * kBlocksASide * MapBlock::kSide;
  return side > 0 && s.spacing <= spacingCode(64.0).value_or(0) &&
         std::abs(static_cast<double>(s.north)) * side <= kFarthest &&
         std::abs(static_cast<double>(s.east)) * side <= kFarthest && s.max_error > 0 &&
         std::isfinite(s.max_error) && !index_.find(s.spacing, s.north, s.east);
}

bool BlockQueue::load(rt::StateReader& reader) {
  std::fill(squares_.begin(), squares_.end(), Square{});
  index_.clear();
  exchange(reader, *this);
  for (std::size_t i = 0; i < squares_.size() && reader.ok(); ++i) {
    Square& s = squares_[i];
    if (!s.used) continue;
    if (!isValid(s)) {
      reader.fail("a square that cannot be");
      break;
    }
    index_.add(s.spacing, s.north, s.east, i);
    for (int k = 0; k < static_cast<int>(s.blocks.size()); ++k)
      s.blocks[static_cast<std::size_t>(k)].content.key = {
          s.spacing, s.north * kBlocksASide + k / kBlocksASide, s.east * kBlocksASide + k % kBlocksASide};
  }
  return reader.ok();
}

template <typename Archive, typename Self>
void SentFrames::exchange(Archive& archive, Self& self) {
  archive(self.next_, self.newest_acknowledged_, self.loss_, self.after_lost_, self.last_lost_,
          self.any_word_, self.counters_);
  exchangeCount(archive, self.held_, kFrames);
  archive.require(self.loss_ >= 0 && self.loss_ <= 1 && self.after_lost_ >= 0 && self.after_lost_ <= 1,
                  "shares of frames that cannot be");
  for (auto& f : self.frames_) {
    archive(f.open, f.arrived);
    archive.instants(f.left_ns);
    if (!f.open) continue;
    exchangeCount(archive, f.blocks, f.block.size());
    for (std::size_t i = 0; i < f.blocks; ++i) exchangeRef(archive, f.block[i]);
  }
}

void SentFrames::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool SentFrames::load(rt::StateReader& reader, std::size_t squares) {
  std::fill(frames_.begin(), frames_.end(), Frame{});
  exchange(reader, *this);
  if (!reader.ok()) return false;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const Frame& f = frames_[i];
    if (!f.open) continue;
    for (const BlockRef& ref : std::span(f.block).first(f.blocks))
      reader.require(ref.square < squares && ref.block < kBlocksASide * kBlocksASide, "a block of no square");
  }
  return reader.ok();
}

template <typename Archive, typename Self>
void RepairEncoder::exchange(Archive& archive, Self& self) {
  const auto group = [&](auto& g) {
    archive(g.first, g.k, g.rows, g.wanted, g.has_map);
    exchangeCount(archive, g.symbol_bytes, kMaxSymbolBytes);
    archive.require(g.k >= 0 && g.k <= kMaxGroup && g.rows >= 0 && g.rows <= g.wanted &&
                        g.wanted <= kMaxRepairRows && (g.k > 0 || g.wanted == 0),
                    "a group of frames that cannot be");
    if constexpr (Archive::kLoading)
      if (!archive.ok()) return;
    for (std::size_t j = 0; j < static_cast<std::size_t>(g.k); ++j) archive(g.symbol[j]);
  };
  group(self.open_);
  archive.require(self.open_.k < kMaxGroup, "an open group that is full");
  for (auto& g : self.closed_) group(g);
  exchangeCount(archive, self.turn_, kGroups - 1);
  archive(self.pending_, self.credit_, self.spread_);
}

void RepairEncoder::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool RepairEncoder::load(rt::StateReader& reader) {
  exchange(reader, *this);
  int pending = 0;
  for (const Group& g : closed_) pending += g.wanted - g.rows;
  reader.require(pending == pending_ && credit_ >= 0 && spread_ >= 0, "repair frames that cannot be");
  return reader.ok();
}

template <typename Archive, typename Self>
void Housekeeping::exchange(Archive& archive, Self& self) {
  bool has_status = self.status_.has_value();
  archive(has_status);
  if constexpr (Archive::kLoading) {
    self.status_.reset();
    if (has_status) self.status_.emplace();
  }
  if (has_status) exchangeStatus(archive, *self.status_);
  archive(self.track_);
  bool has_report = self.report_.has_value();
  archive(has_report, self.sent_health_, self.report_kept_, self.info_kept_);
  if constexpr (Archive::kLoading) {
    self.report_.reset();
    if (has_report) self.report_.emplace();
  }
  if (has_report) {
    auto& r = *self.report_;
    archive(r.health, r.paused, r.rate_bps);
    for (auto& o : r.requests) {
      archive.enumeration(o.state, RequestOutcome::State::kRefused);
      archive(o.id, o.counter);
    }
  }
  archive.instants(self.status_timer_.next_ns, self.info_timer_.next_ns, self.track_timer_.next_ns,
                   self.report_timer_.next_ns);
}

void Housekeeping::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool Housekeeping::load(rt::StateReader& reader) {
  exchange(reader, *this);
  return reader.ok();
}

template <typename Archive, typename Self>
void LinkScheduler::Impl::exchange(Archive& archive, Self& s) {
  archive(s.config.rate_bps);
  archive.require(s.config.rate_bps >= 10 && s.config.rate_bps <= 1e6, "a rate that cannot be");
  archive.instants(s.now, s.busy_until);
  if constexpr (Archive::kLoading) {
    if (!archive.ok()) return;
    s.applyRate();
  }
  archive(s.bucket, s.repair, s.housekeeping, s.turns, s.lasting, s.frames_since_turn);
  auto& c = s.counters;
  archive(c.frames, c.bytes, c.status_frames, c.track_frames, c.info_frames, c.map_frames, c.repair_frames,
          c.report_frames, c.map_bytes, c.turns, c.requests, c.requests_refused, c.reduced_packets);
  exchangeCount(archive, s.detail_known, kMaxDetails);
  exchangeCount(archive, s.detail_count, s.detail_known);
  for (std::size_t i = 0; i < s.detail_known; ++i) {
    auto& d = s.details[i];
    archive(d.north_min, d.north_max, d.east_min, d.east_max, d.spacing, d.max_error, d.request.id,
            d.request.counter);
    Request request;
    request.kind = Request::Kind::kDetail;
    request.north_min = d.north_min, request.north_max = d.north_max;
    request.east_min = d.east_min, request.east_max = d.east_max;
    request.spacing = d.spacing, request.max_error = d.max_error;
    archive.require(validate(request), "a request that cannot be");
  }
  archive(s.queue);
}

void LinkScheduler::save(rt::StateWriter& writer) const {
  writer.section(kLinkTag, kLinkVersion, [&] {
    Impl::exchange(writer, std::as_const(*impl_));
    impl_->sent.save(writer);
  });
}

bool LinkScheduler::load(rt::StateReader& reader) {
  return reader.section(kLinkTag, kLinkVersion, [&] {
    Impl::exchange(reader, *impl_);
    if (reader.ok()) (void)impl_->sent.load(reader, impl_->queue.capacity());
  });
}

}  // namespace fathom::telemetry

// LinkScheduler: what the ship says.
#include <algorithm>
#include <cmath>

#include "telemetry/vehicle/link_scheduler_impl.hpp"

namespace fathom::telemetry {
namespace {

constexpr double kMinRequestedRate = 80, kMaxRequestedRate = 1e5;  // [bit/s]

}  // namespace

void LinkScheduler::Impl::setRate(double rate_bps) {
  const double wanted = std::clamp(rate_bps, kMinRequestedRate, kMaxRequestedRate);
  if (wanted == config.rate_bps) return;  // said again
  config.rate_bps = wanted;
  applyRate();
}

void LinkScheduler::heard(std::int64_t now_ns) {
  impl_->turns.heard(now_ns);
}

void LinkScheduler::acknowledge(const Acknowledgement& acknowledgement, std::int64_t now_ns,
                                const std::function<void(const BlockQueue::Whole&)>& on_whole) {
  Impl& s = *impl_;
  s.turns.heard(now_ns);
  const auto newest = s.sent.newestOf(acknowledgement);
  if (!newest) return s.sent.countForeign();
  s.sent.acknowledge(acknowledgement, *newest, now_ns,
                     [&](Version version, std::span<const BlockRef> blocks, bool arrived) {
                       for (const BlockRef& b : blocks) {
                         if (!arrived) {
                           s.queue.lost(b, version);
                         } else if (const auto whole = s.queue.delivered(b, version); whole && on_whole) {
                           on_whole(*whole);
                         }
                       }
                     });
  s.queue.settle(
      [&](Version version) {
        const auto heard = version <= *newest ? acknowledgement.heardBack(*newest - version) : std::nullopt;
        return heard ? heard : s.sent.wordOf(version);
      },
      s.sent.oldest());
}

std::optional<Version> LinkScheduler::sentLately(const Acknowledgement& a, std::int64_t now_ns,
                                                 double within_s) const {
  const auto newest = impl_->sent.newestOf(a);
  const auto left_ns = newest ? impl_->sent.leftAt(*newest) : std::nullopt;
  if (!left_ns || now_ns - *left_ns > std::llround(within_s * 1e9)) return std::nullopt;
  return newest;
}

void LinkScheduler::request(const Request& r, std::int64_t now_ns) {
  Impl& s = *impl_;
  s.now = std::max(s.now, now_ns);
  s.turns.heard(now_ns);
  if (!validate(r)) {
    ++s.counters.requests_refused;
    return;
  }
  ++s.counters.requests;
  switch (r.kind) {
    case Request::Kind::kRate:
      s.setRate(r.rate_bps);
      return;
    case Request::Kind::kPauseMap:
    case Request::Kind::kResumeMap:
      s.paused = r.kind == Request::Kind::kPauseMap;
      return;
    case Request::Kind::kSendStatus:
      s.housekeeping.sendStatusNow();
      return;
    case Request::Kind::kDetail:
      if (s.detail_count == Impl::kMaxDetails) {
        ++s.counters.requests_refused;
        return;
      }
      s.details[s.detail_count++] = {r.north_min, r.north_max, r.east_min,
                                     r.east_max,  r.spacing,   r.max_error};
      return;
  }
}

const LinkScheduler::Detail* LinkScheduler::detail() const {
  return impl_->detail_count > 0 ? &impl_->details[0] : nullptr;
}

bool LinkScheduler::offerDetail(const HeightTile& tile, std::int64_t now_ns) {
  Impl& s = *impl_;
  if (s.detail_count == 0) return false;
  const double max_error = s.details[0].max_error;
  if (s.config.rate_bps * s.config.duty >= s.config.fast_rate_bps)
    return s.tiles.offer(tile, max_error, s.config.colour_bits);
  s.queue.offer(tile, max_error, now_ns);
  return true;
}

void LinkScheduler::detailServed() {
  Impl& s = *impl_;
  if (s.detail_count == 0) return;
  std::move(s.details.begin() + 1, s.details.begin() + static_cast<std::ptrdiff_t>(s.detail_count),
            s.details.begin());
  --s.detail_count;
}

}  // namespace fathom::telemetry

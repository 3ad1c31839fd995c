// LinkScheduler: takes the ship's messages.
#include <algorithm>
#include <cmath>

#include "realtime/base/units.hpp"
#include "telemetry/vehicle/link_scheduler_impl.hpp"

namespace fathom::telemetry {
namespace {

constexpr double kMinRequestedRate = 80, kMaxRequestedRate = 1e5;  // [bit/s]

}  // namespace

void LinkScheduler::Impl::setRate(double rate_bps) {
  const double wanted = std::clamp(rate_bps, kMinRequestedRate, kMaxRequestedRate);
  if (wanted == config.rate_bps) return;  // a repetition
  config.rate_bps = wanted;
  applyRate();
}

// Reports requests for detail as done of which the ship has everything.
void LinkScheduler::Impl::closeDetails() {
  for (std::size_t k = detail_count; k < detail_known;) {
    const Detail& d = details[k];
    if (queue.hasPending(d.north_min, d.north_max, d.east_min, d.east_max, d.spacing)) {
      ++k;
      continue;
    }
    lasting.become({RequestOutcome::State::kDone, d.request.id, d.request.counter});
    std::move(details.begin() + static_cast<std::ptrdiff_t>(k) + 1,
              details.begin() + static_cast<std::ptrdiff_t>(detail_known),
              details.begin() + static_cast<std::ptrdiff_t>(k));
    --detail_known;
  }
}

void LinkScheduler::received(std::int64_t now_ns) {
  impl_->turns.received(now_ns);
  impl_->lasting.received(now_ns);
}

void LinkScheduler::acknowledge(const Acknowledgement& acknowledgement, std::int64_t now_ns,
                                const std::function<void(const BlockQueue::Whole&)>& on_whole) {
  Impl& s = *impl_;
  received(now_ns);
  const auto newest = s.sent.newestOf(acknowledgement);
  if (!newest) return s.sent.countForeign();
  s.lasting.acknowledged(*newest);
  s.sent.acknowledge(acknowledgement, *newest, now_ns,
                     [&](Version version, std::span<const BlockRef> blocks, bool arrived) {
                       s.housekeeping.word(version, arrived);
                       for (const BlockRef& b : blocks) {
                         if (!arrived) {
                           s.queue.lost(b, version);
                         } else if (const auto whole = s.queue.delivered(b, version); whole && on_whole) {
                           on_whole(*whole);
                         }
                       }
                     });
  const auto holds = [&](Version version) {
    const auto received_by_ship =
        version <= *newest ? acknowledgement.receivedBack(*newest - version) : std::nullopt;
    return received_by_ship ? received_by_ship : s.sent.wordOf(version);
  };
  s.queue.settle(holds, s.sent.oldest());
  s.housekeeping.settle(holds, s.sent.oldest());
  s.closeDetails();
}

std::optional<Version> LinkScheduler::sentLately(const Acknowledgement& a, std::int64_t now_ns,
                                                 double within_s) const {
  const auto newest = impl_->sent.newestOf(a);
  const auto left_ns = newest ? impl_->sent.leftAt(*newest) : std::nullopt;
  if (!left_ns || now_ns - *left_ns > rt::nanoseconds(within_s)) return std::nullopt;
  return newest;
}

void LinkScheduler::request(const Request& r, std::int64_t now_ns, DownlinkCounter counter) {
  using State = RequestOutcome::State;
  Impl& s = *impl_;
  s.now = std::max(s.now, now_ns);
  received(now_ns);
  const bool detail = r.kind == Request::Kind::kDetail;
  RequestOutcome outcome{detail ? State::kTaken : State::kDone, r.id,
                         counter & ((1U << kOutcomeCounterBits) - 1)};
  if (!validate(r) || (detail && s.detail_known == Impl::kMaxDetails)) {
    ++s.counters.requests_refused;
    outcome.state = State::kRefused;
    return s.lasting.note(outcome);
  }
  ++s.counters.requests;
  s.lasting.note(outcome);
  switch (r.kind) {
    case Request::Kind::kRate:
      s.setRate(r.rate_bps);
      s.lasting.rateAsked(s.sent.next(), s.now);
      return;
    case Request::Kind::kPauseMap:
    case Request::Kind::kResumeMap:
      s.lasting.pause(r.kind == Request::Kind::kPauseMap);
      return;
    case Request::Kind::kSendStatus:
      s.housekeeping.sendStatusNow();
      return;
    case Request::Kind::kDetail:
      // Before those that are being sent.
      std::move_backward(s.details.begin() + static_cast<std::ptrdiff_t>(s.detail_count),
                         s.details.begin() + static_cast<std::ptrdiff_t>(s.detail_known),
                         s.details.begin() + static_cast<std::ptrdiff_t>(s.detail_known) + 1);
      s.details[s.detail_count++] = {r.north_min, r.north_max, r.east_min, r.east_max,
                                     r.spacing,   r.max_error, outcome};
      ++s.detail_known;
      return;
  }
}

const LinkScheduler::Detail* LinkScheduler::detail() const {
  return impl_->detail_count > 0 ? &impl_->details[0] : nullptr;
}

void LinkScheduler::detailServed() {
  Impl& s = *impl_;
  if (s.detail_count == 0) return;
  // The request moves behind those that are not offered yet.
  std::rotate(s.details.begin(), s.details.begin() + 1,
              s.details.begin() + static_cast<std::ptrdiff_t>(s.detail_count));
  --s.detail_count;
  s.closeDetails();
}

}  // namespace fathom::telemetry

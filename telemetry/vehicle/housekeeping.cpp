#include "telemetry/vehicle/housekeeping.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "realtime/base/units.hpp"

namespace fathom::telemetry {
namespace {

constexpr double kTrackGoal = 0.99;       // probability that a track point arrives
constexpr unsigned kTrackHeadBits = 100;  // the newest point, count and width
constexpr unsigned kTrackStepBits = 40;   // of an older point: 10 for time, 3 x 10 for up to 51 m of track
constexpr double kReportGoal = 0.99;      // probability that a report arrives without acknowledgement
constexpr int kPromptSendings = 8;        // of an unacknowledged report at the status period; then seldom
constexpr int kSeldom = 6;                // times the period, of what is acknowledged or stays unanswered
constexpr std::size_t kLeastTrackPoints = 4;  // with fewer, status messages carry the same in fewer bytes

}  // namespace

void TrackLog::add(const TrackPoint& point) {
  if (!points_.empty() && point.utc_ns < newestUtcNs()) points_.clear();
  if (points_.size() == kMost) points_.erase(points_.begin(), points_.begin() + kMost / 8);
  points_.push_back({point});
}

std::size_t TrackLog::encode(std::size_t first, std::size_t count, Version version,
                             std::span<std::uint8_t> out) {
  std::array<TrackPoint, kMaxTrackPoints> sent, decoded;
  count = std::min({count, kMaxTrackPoints, points_.size() - first});
  for (std::size_t k = 0; k < count; ++k) sent[k] = points_[first + k].at;
  const std::size_t size = encodeTrack(std::span(sent).first(count), out);
  if (size == 0) return 0;
  // The newest that fit.
  const std::size_t carried = decodeTrack(out.first(size), decoded);
  for (std::size_t k = count - carried; k < count; ++k) {
    points_[first + k].last = version;
    points_[first + k].lost = false;
  }
  return size;
}

std::size_t TrackLog::newest(std::size_t most, Version version, std::span<std::uint8_t> out) {
  if (points_.empty()) return 0;
  const std::size_t count = std::min(most, points_.size());
  return encode(points_.size() - count, count, version, out);
}

std::size_t TrackLog::lost(std::size_t most, Version version, std::span<std::uint8_t> out) {
  const auto first =
      std::find_if(points_.begin(), points_.end(), [](const Point& p) { return p.lost && !p.confirmed; });
  if (first == points_.end()) return 0;
  // As few as fit at any step width, so that the first of them is carried.
  constexpr unsigned kHeadBits = 100, kWidestStepBits = 10 + 3 * 22;
  const std::size_t fit =
      1 + (out.size() * 8 - std::min<std::size_t>(out.size() * 8, kHeadBits)) / kWidestStepBits;
  return encode(static_cast<std::size_t>(first - points_.begin()), std::min(most, fit), version, out);
}

void TrackLog::word(Version version, bool arrived) {
  for (Point& p : points_) {
    if (p.last != version) continue;
    p.confirmed = p.confirmed || arrived;
    p.lost = !p.confirmed;
  }
}

void TrackLog::settle(const BlockQueue::Holds& holds, Version oldest) {
  for (Point& p : points_) {
    // An unacknowledged point stays as it is while its frame may be acknowledged.
    if (p.last == 0 || (!p.confirmed && p.last >= oldest)) continue;
    p.confirmed = holds(p.last).value_or(p.confirmed);
    p.lost = !p.confirmed;
  }
}

int repeatsForGoal(double loss, double goal) {
  if (loss <= 0) return 1;
  return std::max(1, static_cast<int>(std::ceil(std::log1p(-goal) / std::log(loss) - 1e-9)));
}

void HousekeepingConfig::validate() const {
  requireBounds(share >= 0.01 && share <= 1, "housekeeping_share is outside 0.01 to 1");
  requireBounds(status_period_s >= 0.1 && status_period_s <= 3600,
                "status_period_s is outside 0.1 to 3600 s");
  requireBounds(mission_info_period_s >= 1 && mission_info_period_s <= 36000,
                "mission_info_period_s is outside 1 to 36000 s");
  requireBounds(track_interval_s >= 0.1 && track_interval_s <= 600,
                "track_interval_s is outside 0.1 to 600 s");
  requireBounds(track_points >= 2 && track_points <= static_cast<int>(kMaxTrackPoints),
                "track_points is outside 2 to 63");
}

Housekeeping::Housekeeping(const HousekeepingConfig& config, int frame_bytes, double loss)
    : config_((config.validate(), config)),
      room_(static_cast<std::size_t>(frame_bytes) - kFrameOverhead),
      loss_(loss) {}

// Periods as configured, or all stretched by one factor so that housekeeping keeps to its share of the rate.
void Housekeeping::plan(double rate_bps, double least_s) {
  least_s_ = least_s;
  const std::size_t room_bits = room_ * 8;
  const std::size_t fit = 1 + (room_bits - std::min<std::size_t>(room_bits, kTrackHeadBits)) / kTrackStepBits;
  const std::size_t points = std::min(fit, static_cast<std::size_t>(config_.track_points));
  const bool has_track = points >= kLeastTrackPoints;
  const double overhead = static_cast<double>(kFrameOverhead);
  const double status_bytes = kStatusBytes + overhead;
  const double track_bytes =
      overhead + (kTrackHeadBits + static_cast<double>(points - 1) * kTrackStepBits) / 8;
  const double info_bytes = overhead + static_cast<double>(std::min(room_, kMaxNameBytes));
  // Each point is sent often enough to arrive, at least twice in case the loss rate is set too low.
  const int repeats = std::max(2, repeatsForGoal(loss_, kTrackGoal));
  const double track_period =
      std::max(1.0, std::floor(static_cast<double>(points) / repeats)) * config_.track_interval_s;

  const double bits_per_s =
      8 * (status_bytes / config_.status_period_s + (has_track ? track_bytes / track_period : 0) +
           info_bytes / config_.mission_info_period_s);
  stretch_ = std::max({1.0, bits_per_s / (config_.share * rate_bps), least_s / config_.status_period_s});
  track_points_ = has_track ? points : 0;
  track_interval_ns_ = rt::nanoseconds(stretch_ * config_.track_interval_s);
  status_timer_.period_ns = rt::nanoseconds(stretch_ * config_.status_period_s);
  track_timer_.period_ns = rt::nanoseconds(stretch_ * track_period);
  info_timer_.period_ns = rt::nanoseconds(stretch_ * config_.mission_info_period_s);
  report_gap_ns_ = rt::nanoseconds(2 * static_cast<double>(room_bits) / rate_bps);
}

bool Housekeeping::Kept::word(Version version, bool arrived) {
  if (version != last || last == 0) return true;
  confirmed = arrived;
  return arrived;
}

std::size_t Housekeeping::spareTrack(Version version, std::span<std::uint8_t> out) {
  return track_points_ > 0 ? track_.lost(track_points_, version, out.first(std::min(out.size(), room_))) : 0;
}

void Housekeeping::word(Version version, bool arrived) {
  track_.word(version, arrived);
  if (!report_kept_.word(version, arrived)) report_timer_.next_ns = 0;
  if (!info_kept_.word(version, arrived)) info_timer_.next_ns = 0;
}

void Housekeeping::settle(const BlockQueue::Holds& holds, Version oldest) {
  track_.settle(holds, oldest);
  for (const auto& [kept, timer] : {std::pair{&report_kept_, &report_timer_}, {&info_kept_, &info_timer_}}) {
    if (kept->last == 0 || !kept->confirmed || holds(kept->last).value_or(true)) continue;
    kept->confirmed = false;
    timer->next_ns = 0;
  }
}

void Housekeeping::setReport(StateReport report, double loss) {
  report_sendings_ = repeatsForGoal(loss, kReportGoal);
  if (status_) report.health = status_->health;
  const auto outcomes = [](const StateReport& r) { return std::tie(r.paused, r.rate_bps, r.requests); };
  const bool changed = report_ && outcomes(*report_) != outcomes(report);
  // A flag that was cleared waits for the next status.
  const bool raised = (report.health & ~sent_health_) != 0;
  report_ = report;
  if (!changed && !raised) return;
  report_kept_ = {};
  report_timer_.next_ns = 0;
}

void Housekeeping::setStatus(const Status& s) {
  status_ = s;
  if (track_points_ == 0) return;
  const bool set_back = !track_.empty() && s.utc_ns < track_.newestUtcNs();
  if (!track_.empty() && !set_back && s.utc_ns - track_.newestUtcNs() < track_interval_ns_) return;
  track_.add({s.utc_ns, s.north, s.east, s.depth});
}

std::size_t Housekeeping::status(std::int64_t now_ns, std::span<std::uint8_t> out) {
  if (!status_) return 0;
  status_timer_.done(now_ns);
  sent_health_ = status_->health;
  return encodeStatus(*status_, out.first(std::min(out.size(), room_)));
}

std::size_t Housekeeping::spareStatus(std::int64_t now_ns, std::span<std::uint8_t> out) {
  const std::int64_t sent_ns = status_timer_.next_ns - status_timer_.period_ns;
  return now_ns - sent_ns >= rt::nanoseconds(std::max(config_.status_period_s, least_s_))
             ? status(now_ns, out)
             : 0;
}

std::size_t Housekeeping::next(std::int64_t now_ns, Version version, std::span<std::uint8_t> out,
                               MessageType& type) {
  out = out.first(std::min(out.size(), room_));
  if (report_ && !report_kept_.confirmed && report_timer_.due(now_ns)) {
    const int sendings = ++report_kept_.sendings;
    report_timer_.period_ns = sendings < report_sendings_  ? report_gap_ns_
                              : sendings < kPromptSendings ? status_timer_.period_ns
                                                           : kSeldom * status_timer_.period_ns;
    report_timer_.done(now_ns);
    report_kept_.last = version;
    sent_health_ = report_->health;
    type = MessageType::kReport;
    return encodeStateReport(*report_, out);
  }
  if (status_ && status_timer_.due(now_ns)) {
    type = MessageType::kStatus;
    return status(now_ns, out);
  }
  if (info_ && info_timer_.due(now_ns)) {
    info_timer_.done(now_ns);
    // Once acknowledged it is sent for listeners alone.
    if (info_kept_.confirmed) info_timer_.next_ns += (kSeldom - 1) * info_timer_.period_ns;
    if (!info_kept_.confirmed) info_kept_.last = version;
    type = MessageType::kMissionInfo;
    return encodeMissionInfo(*info_, out);
  }
  if (!track_.empty() && track_points_ > 0 && track_timer_.due(now_ns)) {
    track_timer_.done(now_ns);
    type = MessageType::kTrack;
    return track_.newest(track_points_, version, out);
  }
  return 0;
}

}  // namespace fathom::telemetry

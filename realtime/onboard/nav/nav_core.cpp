#include "realtime/onboard/nav/nav_core.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "realtime/base/units.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::onboard {
namespace {

using rt::nanoseconds;

// A damaged stamp at the end of time must not overflow; odometry and pairing then refuse it.
std::int64_t shifted(std::int64_t utc_ns, std::int64_t offset_ns) noexcept {
  std::int64_t sum = 0;
  return __builtin_add_overflow(utc_ns, offset_ns, &sum) ? utc_ns : sum;
}

}  // namespace

std::optional<StereoPairing::Pair> StereoPairing::add(CameraSide side, const Frame& frame) noexcept {
  Stream& own = streams_[static_cast<std::size_t>(side)];
  Stream& other = streams_[1 - static_cast<std::size_t>(side)];
  const std::int64_t before_ns = own.times.any() ? own.times.newestUtcNs() : 0;
  if (own.times.check(frame.utc_ns) != nav::TimeCheck::kGood) {
    ++refused_;
    return std::nullopt;
  }
  if (before_ns != 0 && (period_ns_ == 0 || frame.utc_ns - before_ns < period_ns_))
    period_ns_ = frame.utc_ns - before_ns;
  // So much wider only as no other frame comes into question.
  const std::int64_t drift_ns = driftAt(frame.utc_ns);
  const std::int64_t within_ns = tolerance_ns_ + (2 * drift_ns + tolerance_ns_ < period_ns_ ? drift_ns : 0);

  // The frame's time by the other camera's clock.
  const std::int64_t expected_ns =
      side == CameraSide::kLeft ? frame.utc_ns + skew_ns_ : frame.utc_ns - skew_ns_;
  // A frame earlier than this one by more than the tolerance matches no later one either.
  while (!other.waiting.empty() && other.waiting.front().utc_ns < expected_ns - within_ns) {
    other.waiting.popFront();
    ++other.unpaired;
  }
  std::size_t nearest = other.waiting.size();
  std::int64_t nearest_ns = within_ns;
  for (std::size_t i = 0; i < other.waiting.size(); ++i) {
    const std::int64_t difference = std::abs(other.waiting[i].utc_ns - expected_ns);
    if (difference > nearest_ns) continue;
    nearest = i;
    nearest_ns = difference;
  }
  if (nearest == other.waiting.size()) {
    if (own.waiting.pushDroppingOldest(frame)) ++own.unpaired;
    return std::nullopt;
  }

  const Frame partner = other.waiting[nearest];
  for (std::size_t i = 0; i < nearest; ++i) {
    other.waiting.popFront();
    ++other.unpaired;
  }
  other.waiting.popFront();
  const Pair pair = side == CameraSide::kLeft ? Pair{frame, partner} : Pair{partner, frame};
  followSkew(pair);
  return pair;
}

std::int64_t StereoPairing::driftAt(std::int64_t utc_ns) const noexcept {
  return newest_pair_ns_ == 0 ? 0 : std::max<std::int64_t>(utc_ns - newest_pair_ns_, 0) / kDriftShare;
}

void StereoPairing::followSkew(const Pair& pair) noexcept {
  const std::int64_t drift_ns = driftAt(pair.left.utc_ns);
  newest_pair_ns_ = pair.left.utc_ns;
  const std::int64_t off_ns = pair.right.utc_ns - pair.left.utc_ns - skew_ns_;
  const std::int64_t follow_ns = std::abs(off_ns) > tolerance_ns_ ? off_ns : off_ns / kSkewFollow;
  skew_ns_ += std::clamp(follow_ns, -drift_ns, drift_ns);
}

NavCore::NavCore(const NavCoreConfig& config)
    : predicts_(config.predict_pairs),
      odometry_(config.odometry),
      pairing_(nanoseconds(config.pairing_tolerance), config.start_utc_ns),
      left_offset_ns_(nanoseconds(config.time_offsets.left_camera)),
      right_offset_ns_(nanoseconds(config.time_offsets.right_camera)),
      dvl_offset_ns_(nanoseconds(config.time_offsets.dvl)),
      compass_offset_ns_(nanoseconds(config.time_offsets.compass)),
      depth_offset_ns_(nanoseconds(config.time_offsets.depth)) {}

template <class Sample>
void NavCore::take(Sample sample, std::int64_t offset_ns, LastSeen* seen) noexcept {
  ++counters_.inputs;
  sample.utc_ns = shifted(sample.utc_ns, offset_ns);
  if (seen != nullptr) *seen = {sample.utc_ns, true};
  odometry_.add(sample);
  dispatch();
}

void NavCore::add(const DvlSample& sample) noexcept {
  take(sample, dvl_offset_ns_, &dvl_);
}
void NavCore::add(const AttitudeSample& sample) noexcept {
  take(sample, compass_offset_ns_, &attitude_);
}
void NavCore::add(const GyroSample& sample) noexcept {
  take(sample, compass_offset_ns_, nullptr);
}
void NavCore::add(const DepthSample& sample) noexcept {
  take(sample, depth_offset_ns_, &depth_);
}
void NavCore::add(const WaterSample& sample) noexcept {
  take(sample, 0, &water_);
}

void NavCore::addFrame(std::int64_t stamp_utc_ns, CameraSide side, std::uint32_t frame_id) noexcept {
  ++counters_.inputs;
  const bool left = side == CameraSide::kLeft;
  const std::int64_t utc_ns = shifted(stamp_utc_ns, left ? left_offset_ns_ : right_offset_ns_);
  (left ? left_ : right_) = {utc_ns, true};
  if (const auto pair = pairing_.add(side, {utc_ns, frame_id})) {
    const auto index = static_cast<std::uint32_t>(counters_.pairs++);
    if (waiting_.pushDroppingOldest({index, *pair, false})) ++counters_.pairs_uncovered;
  }
  dispatch();
  if (predicts_) predict();
}

void NavCore::tick(std::int64_t utc_ns) noexcept {
  ++counters_.inputs;
  takeHealth(utc_ns);
  dispatch();
}

// Sends off the pairs that the odometry has reached.
void NavCore::dispatch() noexcept {
  while (odometry_.initialised() && !waiting_.empty()) {
    const WaitingPair pair = waiting_.front();
    if (pair.frames.left.utc_ns > odometry_.newestUtcNs()) return;
    waiting_.popFront();
    const auto pose = odometry_.poseAt(pair.frames.left.utc_ns);
    if (!pose) {  // before the odometry began, or too old for its history
      ++counters_.pairs_uncovered;
      continue;
    }
    give(pair, pair.predicted ? StereoTrigger::Pose::kCorrected : StereoTrigger::Pose::kFinal, *pose);
  }
}

// Sends off the newest pair where it probably is, unless one before it still waits to be sent off at all.
void NavCore::predict() noexcept {
  const std::size_t count = waiting_.size();
  if (count == 0 || waiting_[count - 1].predicted || (count > 1 && !waiting_[count - 2].predicted)) return;
  WaitingPair& pair = waiting_[count - 1];
  const auto pose = odometry_.predictAt(pair.frames.left.utc_ns);
  if (!pose) return;
  pair.predicted = true;
  ++counters_.pairs_predicted;
  give(pair, StereoTrigger::Pose::kPredicted, *pose);
}

void NavCore::give(const WaitingPair& pair, StereoTrigger::Pose what, const SE3& T_odom_body) noexcept {
  StereoTrigger trigger;
  trigger.pose = what;
  trigger.pair_index = pair.index;
  trigger.utc_ns = pair.frames.left.utc_ns;
  trigger.left_frame_id = pair.frames.left.frame_id;
  trigger.right_frame_id = pair.frames.right.frame_id;
  trigger.T_odom_body = T_odom_body;
  if (const auto altitude = odometry_.altitude()) {
    trigger.altitude = *altitude;
    trigger.altitude_valid = true;
  }
  trigger.quality = odometry_.qualityAt(trigger.utc_ns);
  if (what != StereoTrigger::Pose::kPredicted) ++counters_.triggers;
  if (triggers_.pushDroppingOldest(trigger)) ++counters_.triggers_dropped;
}

std::optional<StereoTrigger> NavCore::pollTrigger() noexcept {
  if (triggers_.empty()) return std::nullopt;
  const StereoTrigger trigger = triggers_.front();
  triggers_.popFront();
  return trigger;
}

void NavCore::takeHealth(std::int64_t utc_ns) noexcept {
  // In floating point, because a damaged stamp may have any value; never negative: a sample may be stamped
  // after the tick that it arrived before.
  const auto age = [utc_ns](const LastSeen& seen) {
    if (!seen.any) return -1.0;
    return std::max(0.0,
                    (static_cast<double>(utc_ns) - static_cast<double>(seen.utc_ns)) / kNanosecondsPerSecond);
  };
  health_.utc_ns = utc_ns;
  health_.dvl_age = age(dvl_);
  health_.attitude_age = age(attitude_);
  health_.depth_age = age(depth_);
  health_.water_age = age(water_);
  health_.left_age = age(left_);
  health_.right_age = age(right_);
  health_.initialised = odometry_.initialised();
  health_.odometry_age = age({odometry_.newestUtcNs(), odometry_.initialised()});
  health_.altitude = odometry_.altitude();
  health_.speed = odometry_.velocityBody().norm();
  if (const auto pose = odometry_.poseAt(odometry_.newestUtcNs())) health_.depth = pose->translation().z();
  health_.waiting_pairs = waiting_.size();

  const nav::DeadReckoning::Counters& track = odometry_.counters();
  health_.counters = {{
      {"inputs", counters_.inputs},
      {"pairs", counters_.pairs},
      {"pairs_predicted", counters_.pairs_predicted},
      {"pairs_uncovered", counters_.pairs_uncovered},
      {"triggers", counters_.triggers},
      {"triggers_dropped", counters_.triggers_dropped},
      {"left_unpaired", pairing_.unpaired(CameraSide::kLeft)},
      {"right_unpaired", pairing_.unpaired(CameraSide::kRight)},
      {"frames_refused", pairing_.refused()},
      {"dvl_used", track.dvl_used},
      {"dvl_without_bottom", track.dvl_without_bottom},
      {"dvl_rejected", track.dvl_rejected},
      {"dvl_before_start", track.dvl_before_start},
      {"dvl_queue_full", track.dvl_queue_full},
      {"dvl_coasted", track.coasted},
      {"sound_speed_absent", track.sound_speed_absent},
      {"attitude_rejected", track.attitude_rejected},
      {"attitude_held", track.attitude_held},
      {"heading_leaps", track.heading_leaps},
      {"gyro_used", track.gyro_used},
      {"gyro_rejected", track.gyro_rejected},
      {"depth_rejected", track.depth_rejected},
      {"depth_held", track.depth_held},
      {"water_rejected", track.water_rejected},
      {"out_of_order", track.out_of_order},
      {"time_leaps", track.time_leaps},
  }};
}

namespace {

constexpr std::uint32_t kTag = rt::stateTag("NAVC"), kFeedTag = rt::stateTag("NAVF"), kVersion = 7;

template <typename Archive, typename Health>
void exchangeHealth(Archive& archive, Health& health) {
  archive(health.utc_ns, health.dvl_age, health.attitude_age, health.depth_age, health.water_age,
          health.left_age, health.right_age, health.initialised, health.odometry_age, health.altitude,
          health.depth, health.speed);
  std::uint64_t waiting = health.waiting_pairs;
  archive(waiting);
  if constexpr (Archive::kLoading) health.waiting_pairs = static_cast<std::size_t>(waiting);
  for (auto& counter : health.counters) archive(counter.value);
}

}  // namespace

template <typename Archive, typename Self>
void NavCore::exchange(Archive& archive, Self& self) {
  archive(self.odometry_, self.pairing_, self.waiting_, self.triggers_, self.dvl_, self.attitude_,
          self.depth_, self.water_, self.left_, self.right_, self.counters_);
  exchangeHealth(archive, self.health_);
}

void NavCore::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
}

bool NavCore::load(rt::StateReader& reader) {
  takeHealth(0);  // for the counters' names
  return reader.section(kTag, kVersion, [&] { exchange(reader, *this); });
}

void NavFeed::save(rt::StateWriter& writer) const {
  writer(core_);
  writer.section(kFeedTag, kVersion, [&] { writer(left_clock_, right_clock_, exposures_); });
}

bool NavFeed::load(rt::StateReader& reader) {
  return reader(core_) &&
         reader.section(kFeedTag, kVersion, [&] { reader(left_clock_, right_clock_, exposures_); });
}

}  // namespace fathom::onboard

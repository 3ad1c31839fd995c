#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "realtime/base/units.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::nav {
namespace {

using rt::seconds;

constexpr std::int64_t kMinNodeSpacingNs = 20'000'000;  // with kNodes: at least 20 s of history
constexpr std::int64_t kRateHalfWindowNs =
    200'000'000;                       // each side, of the rate of turn: two compass samples
constexpr double kHeadingNoise = 0.1;  // no leap [rad]: ten times a compass's noise and more
constexpr double kMinSoundSpeed = 1350.0, kMaxSoundSpeed = 1650.0;  // any sea or lake, with margin [m/s]
constexpr double kNominalSoundSpeed = 1500.0;                       // default of instruments [m/s]
// Standard deviation of the speed of sound that an instrument computes from its thermometer and a salinity
// that it was set to: 5 psu of salinity are 7 m/s. And of the nominal one: fresh water near freezing has
// 1405, a warm sea 1550 m/s [1].
constexpr double kComputedShare = 0.005, kNominalShare = 0.025;
constexpr double kMinDepth = -5.0, kMaxDepth = 11500.0;  // above the surface in a swell; deepest trench [m]
// The same velocity and ranges so often and so long: a DVL that sends, but measures no more. Its noise and
// the last digit of four ranges change several times a second even where a vehicle rests.
constexpr std::uint32_t kStuckRepeats = 4;
constexpr std::int64_t kStuckNs = kNanosecondsPerSecond;
constexpr double kMaxAltitude = 500.0;  // beyond any bottom track of a survey DVL [m]

bool possibleSoundSpeed(double c) {
  return c >= kMinSoundSpeed && c <= kMaxSoundSpeed;
}

std::optional<double> measuredAltitude(const DvlSample& sample) {
  if (sample.altitude) return sample.altitude;
  // All four beams together cancel the slope of the bottom and the tilt; fewer do not.
  double sum = 0;
  for (const std::optional<double>& range : sample.range) {
    if (!range) return std::nullopt;
    sum += *range / static_cast<double>(sample.range.size());
  }
  return sum;
}

// Whether times rise, as searches by time assume.
bool rises(const auto& queue) {
  for (std::size_t i = 1; i < queue.size(); ++i)
    if (queue[i].utc_ns <= queue[i - 1].utc_ns) return false;
  return true;
}

}  // namespace

DeadReckoning::DeadReckoning(const DeadReckoningConfig& config)
    : config_(config),
      R_body_compass_inverse_(config.T_body_compass.rotation().conjugate()),
      sound_speed_(config.sound_speed) {}

bool DeadReckoning::checkTime(TimeGate& gate, std::int64_t utc_ns) noexcept {
  const TimeCheck result = gate.check(utc_ns);
  if (result == TimeCheck::kOutOfOrder) ++counters_.out_of_order;
  if (result == TimeCheck::kLeap || result == TimeCheck::kImpossible) ++counters_.time_leaps;
  if (result != TimeCheck::kGood) return false;
  now_ = std::max(now_, utc_ns);
  return true;
}

double DeadReckoning::soundSpeedFactor(double assumed) noexcept {
  const bool possible = possibleSoundSpeed(assumed);
  own_sound_speed_ = own_sound_speed_ || (possible && assumed != kNominalSoundSpeed);
  if (possible) return sound_speed_.value_or(assumed) / assumed;
  ++counters_.sound_speed_absent;
  return 1.0;
}

double DeadReckoning::soundShare() const noexcept {
  if (sound_speed_ || config_.phased_array) return 0;
  return own_sound_speed_ ? kComputedShare : kNominalShare;
}

bool DeadReckoning::stuck(const DvlSample& sample) noexcept {
  Reading now{.since_ns = sample.utc_ns};
  bool whole = sample.velocity && sample.velocity->allFinite();
  if (whole) now.velocity = *sample.velocity;
  for (std::size_t beam = 0; beam < now.range.size(); ++beam) {
    now.range[beam] = sample.range[beam].value_or(0);
    whole = whole && std::isfinite(now.range[beam]);
  }
  const bool measured = whole && now.range != Reading().range;
  if (!measured || now.velocity != reading_.velocity || now.range != reading_.range) {
    reading_ = measured ? now : Reading();
    return false;
  }
  ++reading_.repeats;
  return reading_.repeats >= kStuckRepeats && sample.utc_ns - reading_.since_ns >= kStuckNs;
}

void DeadReckoning::add(const DvlSample& sample) noexcept {
  if (!checkTime(dvl_times_, sample.utc_ns)) return;
  if (stuck(sample)) {
    ++counters_.dvl_rejected;
    advance();
    return;
  }
  const double factor = soundSpeedFactor(sample.sound_speed);
  if (const auto altitude = measuredAltitude(sample); altitude && *altitude > 0 && *altitude < kMaxAltitude)
    altitude_ = {sample.utc_ns, *altitude * factor};
  if (!sample.velocity) {
    ++counters_.dvl_without_bottom;
  } else if (!(sample.velocity->norm() * factor <= config_.max_speed)) {  // also what is not a number
    ++counters_.dvl_rejected;
  } else {
    Eigen::Vector3d corrected = *sample.velocity * factor;
    if (config_.phased_array) corrected.head<2>() = sample.velocity->head<2>();
    const Velocity velocity{sample.utc_ns, config_.T_body_dvl.rotation() * corrected};
    if (waiting_.pushDroppingOldest(velocity)) ++counters_.dvl_queue_full;
  }
  advance();
}

void DeadReckoning::add(const AttitudeSample& sample) noexcept {
  const bool possible = std::isfinite(sample.heading) && std::abs(sample.heading) <= 4 * std::numbers::pi &&
                        std::abs(sample.roll) <= std::numbers::pi &&
                        std::abs(sample.pitch) <= std::numbers::pi / 2;
  if (!possible) {
    ++counters_.attitude_rejected;
    return;
  }
  if (!checkTime(attitude_times_, sample.utc_ns)) return;
  const double east = nodes_.empty() ? 0.0 : nodes_.back().p_dvl.y();
  const double north_of_nav = (sample.magnetic ? config_.magnetic_declination : 0.0) -
                              meridianConvergence(east, config_.origin_latitude);
  const double heading = withoutLeap(sample.heading + north_of_nav, sample.utc_ns);
  const SE3 R_odom_compass = SE3::fromEuler(sample.roll, sample.pitch, heading, Eigen::Vector3d::Zero());
  attitudes_.pushDroppingOldest({sample.utc_ns, R_odom_compass.rotation() * R_body_compass_inverse_});
  advance();
}

// The heading less all leaps; a new leap is a turn that no vehicle makes. After a silence a turn and a leap
// cannot be distinguished, and a turn is assumed.
double DeadReckoning::withoutLeap(double heading, std::int64_t utc_ns) noexcept {
  double smooth = heading - removed_heading_;
  if (!attitudes_.empty()) {
    const double turn = wrapAngle(smooth - last_heading_);
    if (std::abs(turn) > kHeadingNoise + config_.max_turn_rate * seconds(utc_ns - attitudes_.back().utc_ns)) {
      removed_heading_ = wrapAngle(removed_heading_ + turn);
      smooth -= turn;
      ++counters_.heading_leaps;
      leap_times_.pushDroppingOldest(utc_ns);
    }
  }
  last_heading_ = smooth;
  return smooth;
}

void DeadReckoning::add(const GyroSample& sample) noexcept {
  const auto rate = bodyRate(sample, config_.T_body_compass.rotation());
  if (!rate) {
    ++counters_.gyro_rejected;
    return;
  }
  if (!checkTime(gyro_times_, sample.utc_ns)) return;
  rates_.pushDroppingOldest(*rate);
  ++counters_.gyro_used;
  advance();
}

void DeadReckoning::add(const DepthSample& sample) noexcept {
  if (!(sample.depth >= kMinDepth && sample.depth <= kMaxDepth)) {
    ++counters_.depth_rejected;
    return;
  }
  if (!checkTime(depth_times_, sample.utc_ns)) return;
  const double tide = config_.tide ? config_.tide->heightAt(sample.utc_ns) : 0;
  depths_.pushDroppingOldest({sample.utc_ns, sample.depth - tide});
  advance();
}

void DeadReckoning::add(const WaterSample& sample) noexcept {
  if (!sample.sound_speed) return;
  // Sound speed changes over minutes: the newest to arrive serves, whatever its stamp.
  if (possibleSoundSpeed(*sample.sound_speed))
    sound_speed_ = *sample.sound_speed;
  else
    ++counters_.water_rejected;
}

// Whether a sensor's samples reach a time, or have stopped and are no longer waited for.
bool DeadReckoning::reached(const TimeGate& gate, std::int64_t utc_ns) const noexcept {
  return gate.newestUtcNs() >= utc_ns || gate.silentAt(now_);
}

void DeadReckoning::advance() noexcept {
  if (attitudes_.empty() || depths_.empty()) return;
  while (!waiting_.empty()) {
    const Velocity next = waiting_.front();
    if (!reached(attitude_times_, next.utc_ns) || !reached(depth_times_, next.utc_ns)) return;
    if (gyro_times_.any() && !reached(gyro_times_, next.utc_ns)) return;
    waiting_.popFront();
    use(next);
  }
  coast();
}

void DeadReckoning::use(const Velocity& velocity) noexcept {
  if (nodes_.empty()) {
    // Without attitude and depth at its own time the first pose would be a guess.
    if (velocity.utc_ns < attitudes_.front().utc_ns || velocity.utc_ns < depths_.front().utc_ns) {
      ++counters_.dvl_before_start;
      return;
    }
    last_velocity_ = velocity;
    appendNode(velocity.utc_ns, velocity.value);
    ++counters_.dvl_used;
    return;
  }
  if (velocity.utc_ns <= nodes_.back().utc_ns) {  // the track had to coast past it
    ++counters_.out_of_order;
    // But the bottom is there again: the track waits for the next ensembles
    // instead of coasting past them too.
    last_velocity_ = velocity;
    coasting_ = false;
    return;
  }
  if (attitude_times_.newestUtcNs() < velocity.utc_ns) ++counters_.attitude_held;
  if (depth_times_.newestUtcNs() < velocity.utc_ns) ++counters_.depth_held;

  const Node& from = nodes_.back();
  const std::int64_t begin = from.utc_ns;
  const Eigen::Vector3d first = from.R_odom_body.conjugate() * from.v_dvl;
  const double span = static_cast<double>(velocity.utc_ns - begin);
  coasting_ = false;
  trackTo(velocity.utc_ns, [&](std::int64_t t) -> Eigen::Vector3d {
    return first + (velocity.value - first) * (static_cast<double>(t - begin) / span);
  });
  last_velocity_ = velocity;
  ++counters_.dvl_used;
}

// Continues without bottom track once it has been away for longer than max_dvl_gap: the body's last velocity
// along its own axes, held for the gap, then decaying with the gap as time constant.
void DeadReckoning::coast() noexcept {
  if (nodes_.empty()) return;
  std::int64_t until = attitude_times_.newestUtcNs();
  for (const TimeGate* gate : {&depth_times_, &gyro_times_})
    if (gate->any() && !gate->silentAt(now_)) until = std::min(until, gate->newestUtcNs());
  const auto gap_ns = rt::nanoseconds(config_.max_dvl_gap);
  if (until - last_velocity_.utc_ns <= gap_ns || until <= nodes_.back().utc_ns) return;
  const Eigen::Vector3d& r = config_.T_body_dvl.translation();
  if (!coasting_) {
    ++counters_.coasted;
    coasting_ = true;
    coast_velocity_ = last_velocity_.value - rateOfTurn(last_velocity_.utc_ns).cross(r);
  }
  trackTo(until, [&](std::int64_t t) -> Eigen::Vector3d {
    const double over = seconds(t - last_velocity_.utc_ns - gap_ns);
    const double left = over <= 0 ? 1.0 : std::exp(-over / config_.max_dvl_gap);
    return left * coast_velocity_ + rateOfTurn(t).cross(r);
  });
}

// In body axes [rad/s], from attitudes on both sides of a time as far as there are any.
Eigen::Vector3d DeadReckoning::rateOfTurn(std::int64_t utc_ns) const noexcept {
  const std::int64_t begin = std::max(utc_ns - kRateHalfWindowNs, attitudes_.front().utc_ns);
  const std::int64_t end = std::min(utc_ns + kRateHalfWindowNs, attitudes_.back().utc_ns);
  if (end <= begin) return Eigen::Vector3d::Zero();
  const Eigen::AngleAxisd turn(rotationAt(attitudes_, begin).conjugate() * rotationAt(attitudes_, end));
  return turn.axis() * (turn.angle() / seconds(end - begin));
}

// Appends nodes up to `utc_ns`: at each attitude, depth and gyro sample until then, if not too close to the
// last node, and at `utc_ns`.
void DeadReckoning::trackTo(std::int64_t utc_ns, const auto& velocity_at) noexcept {
  for (;;) {
    const std::int64_t earliest = nodes_.back().utc_ns + kMinNodeSpacingNs - 1;
    std::int64_t next = utc_ns;
    const auto stopAt = [&](const auto& history) {
      if (const std::size_t i = firstAfter(history, earliest); i < history.size())
        next = std::min(next, history[i].utc_ns);
    };
    stopAt(attitudes_);
    stopAt(depths_);
    stopAt(rates_);
    appendNode(next, velocity_at(next));
    if (next == utc_ns) return;
  }
}

void DeadReckoning::appendNode(std::int64_t utc_ns, const Eigen::Vector3d& velocity_body) noexcept {
  Node node;
  node.utc_ns = utc_ns;
  node.R_odom_body = rotationAt(attitudes_, utc_ns);
  node.v_dvl = node.R_odom_body * velocity_body;
  if (nodes_.empty()) {
    node.p_dvl = node.R_odom_body * config_.T_body_dvl.translation();
    placeDepth(node, nullptr);
  } else {
    const Node& before = nodes_.back();
    node.p_dvl = before.p_dvl + 0.5 * (before.v_dvl + node.v_dvl) * seconds(utc_ns - before.utc_ns);
    rate(node, before);
    placeDepth(node, &before);
  }
  nodes_.pushDroppingOldest(node);
}

void DeadReckoning::rate(Node& node, const Node& before) const noexcept {
  const std::int64_t tilt_known = std::max(attitude_times_.newestUtcNs(), before.utc_ns);
  node.quality = before.quality;
  node.quality.unlocked_s += coasting_ ? seconds(node.utc_ns - before.utc_ns) : 0.0;
  node.quality.untilted_s += std::max(0.0, seconds(node.utc_ns - tilt_known));
  node.quality.attitude_held = attitude_times_.newestUtcNs() < node.utc_ns;
  node.quality.depth_held = depth_times_.newestUtcNs() < node.utc_ns;
  const GyroTurn turn = turnBetween(rates_, attitudes_, before.utc_ns, node.utc_ns, gyro_times_.silenceNs());
  node.quality.gyro_turn += turn.angle;
  node.quality.ungyro_s += turn.silent_s;
  node.heading_rate = headingRateAt(rates_, attitudes_, node.utc_ns, gyro_times_.silenceNs());
  followCompass(node, before);
}

void DeadReckoning::followCompass(Node& node, const Node& before) const noexcept {
  Quality& q = node.quality;
  if (q.ungyro_s > before.quality.ungyro_s) {
    q.compass_off = q.compass_off_sum = q.compass_off_s = 0;
    return;
  }
  const auto heading = [](const Node& at) {
    return SE3(at.R_odom_body, Eigen::Vector3d::Zero()).euler().z();
  };
  const double s = seconds(node.utc_ns - before.utc_ns);
  q.compass_off += wrapAngle(heading(node) - heading(before) - (q.gyro_turn - before.quality.gyro_turn));
  q.compass_off_sum += 0.5 * (before.quality.compass_off + q.compass_off) * s;
  q.compass_off_s += s;
}

// Depth by pressure and the DVL (DepthFilter); `before`: null at first.
void DeadReckoning::placeDepth(Node& node, const Node* before) noexcept {
  const double lever = (node.R_odom_body * config_.T_body_depth.translation()).z();
  const double pressure = numberAt(depths_, node.utc_ns) - lever;
  if (before == nullptr) {
    depth_filter_.start(pressure);
  } else {
    const Eigen::Vector3d& r = config_.T_body_dvl.translation();
    const double moved =
        (node.p_dvl - node.R_odom_body * r).z() - (before->p_dvl - before->R_odom_body * r).z();
    const double elapsed = seconds(node.utc_ns - before->utc_ns);
    if (depth_times_.newestUtcNs() < node.utc_ns)  // the sensor is silent: reached() would have waited
      depth_filter_.addWithoutPressure(moved);
    else if (coasting_)
      depth_filter_.addWithoutVelocity(elapsed, moved, pressure);
    else
      depth_filter_.add(elapsed, moved, pressure);
  }
  node.depth = depth_filter_.depth();
  node.quality.pressure_off = depth_filter_.pressureOff();
  node.quality.pressure_sigma = depth_filter_.sigma();
}

void DeadReckoning::exchange(auto& archive, auto& self) {
  archive.instants(self.now_);
  archive(self.dvl_times_, self.reading_, self.attitude_times_, self.depth_times_, self.gyro_times_,
          self.attitudes_, self.last_heading_, self.removed_heading_, self.leap_times_, self.depths_,
          self.rates_, self.waiting_, self.nodes_, self.last_velocity_, self.coast_velocity_, self.coasting_,
          self.depth_filter_, self.sound_speed_, self.own_sound_speed_, self.altitude_, self.counters_);
  // The track assumes that both have samples.
  archive.require(self.nodes_.empty() || (!self.attitudes_.empty() && !self.depths_.empty()),
                  "a track without attitude or depth");
  archive.require(self.leap_times_.size() <= self.counters_.heading_leaps, "leaps that were not counted");
  archive.require(rises(self.nodes_) && rises(self.attitudes_) && rises(self.depths_) && rises(self.rates_),
                  "times that do not rise");
}

void DeadReckoning::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool DeadReckoning::load(rt::StateReader& reader) {
  exchange(reader, *this);
  return reader.ok();
}

}  // namespace fathom::nav

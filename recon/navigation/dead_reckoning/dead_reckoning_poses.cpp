// Dead reckoning at a time: pose, quality, velocity.
#include <algorithm>

#include "realtime/base/units.hpp"
#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"

namespace fathom::nav {
namespace {

using rt::seconds;

constexpr std::int64_t kMaxExtrapolationNs = kSecond_ns;  // beyond the last sensor sample

}  // namespace

std::optional<SE3> DeadReckoning::poseAt(std::int64_t utc_ns) const noexcept {
  if (nodes_.empty() || utc_ns < nodes_.front().utc_ns) return std::nullopt;
  const Eigen::Vector3d& r = config_.T_body_dvl.translation();
  const std::size_t after = firstAfter(nodes_, utc_ns);
  const Node& a = nodes_[after - 1];
  const double s = seconds(utc_ns - a.utc_ns);
  if (after == nodes_.size()) {
    if (utc_ns - a.utc_ns >
        std::max({kMaxExtrapolationNs, attitude_times_.silenceNs(), depth_times_.silenceNs()}))
      return std::nullopt;
    const Eigen::Quaterniond R = s == 0 ? a.R_odom_body : rotationAt(attitudes_, utc_ns);
    Eigen::Vector3d p = a.p_dvl + a.v_dvl * s - R * r;
    p.z() = a.depth + a.v_dvl.z() * s;
    return SE3(R, p);
  }
  // Velocity is linear between nodes, as in the trapezoids: the track has no corner.
  const Node& b = nodes_[after];
  const double span = seconds(b.utc_ns - a.utc_ns);
  const Eigen::Quaterniond R = a.R_odom_body.slerp(s / span, b.R_odom_body);
  Eigen::Vector3d p = a.p_dvl + a.v_dvl * s + (b.v_dvl - a.v_dvl) * (0.5 * s * s / span) - R * r;
  p.z() = a.depth + (b.depth - a.depth) * (s / span);
  return SE3(R, p);
}

// From the newest node through the velocities that wait for attitude and depth, then on with the last one.
std::optional<SE3> DeadReckoning::predictAt(std::int64_t utc_ns) const noexcept {
  if (nodes_.empty() || utc_ns <= nodes_.back().utc_ns) return poseAt(utc_ns);
  const Node& from = nodes_.back();
  const std::int64_t known = std::max(from.utc_ns, waiting_.empty() ? 0 : waiting_.back().utc_ns);
  if (utc_ns - std::min(known, attitudes_.back().utc_ns) > kMaxExtrapolationNs) return std::nullopt;
  std::int64_t time = from.utc_ns;
  Eigen::Vector3d p = from.p_dvl, v = from.v_dvl;
  const auto goTo = [&](std::int64_t next, const Eigen::Vector3d& velocity) {
    p += 0.5 * (v + velocity) * seconds(next - time);
    v = velocity;
    time = next;
  };
  for (std::size_t i = 0; i < waiting_.size() && time < utc_ns; ++i) {
    const Velocity& next = waiting_[i];
    const Eigen::Vector3d there = turnedOn(next.utc_ns) * next.value;
    if (next.utc_ns > utc_ns)
      goTo(utc_ns, v + (there - v) * (seconds(utc_ns - time) / seconds(next.utc_ns - time)));
    else
      goTo(next.utc_ns, there);
  }
  const Eigen::Quaterniond R = turnedOn(utc_ns);
  if (time < utc_ns) goTo(utc_ns, R * (turnedOn(time).conjugate() * v));
  const Eigen::Vector3d& r = config_.T_body_dvl.translation();
  Eigen::Vector3d body = p - R * r;
  body.z() += from.depth - (from.p_dvl - from.R_odom_body * r).z();
  return SE3(R, body);
}

// Attitude, beyond the newest sample by the rate of turn before it.
Eigen::Quaterniond DeadReckoning::turnedOn(std::int64_t utc_ns) const noexcept {
  const TimedRotation& newest = attitudes_.back();
  if (utc_ns <= newest.utc_ns) return rotationAt(attitudes_, utc_ns);
  const Eigen::Vector3d turn = rateOfTurn(newest.utc_ns) * seconds(utc_ns - newest.utc_ns);
  const double angle = turn.norm();
  if (angle == 0) return newest.value;
  return newest.value * Eigen::Quaterniond(Eigen::AngleAxisd(angle, turn / angle));
}

std::optional<double> DeadReckoning::altitude() const noexcept {
  if (!altitude_ || seconds(now_ - altitude_->utc_ns) > config_.max_dvl_gap) return std::nullopt;
  return altitude_->value;
}

DeadReckoning::Quality DeadReckoning::qualityAt(std::int64_t utc_ns) const noexcept {
  if (nodes_.empty()) return {};
  const std::size_t after = std::clamp<std::size_t>(firstAfter(nodes_, utc_ns), 1, nodes_.size());
  const Node& a = nodes_[after - 1];
  Quality quality = a.quality;
  if (after < nodes_.size() && utc_ns > a.utc_ns) {
    const Node& b = nodes_[after];
    const double s = seconds(utc_ns - a.utc_ns), span = seconds(b.utc_ns - a.utc_ns), share = s / span;
    const auto between = [&](double Quality::*sum) {
      return a.quality.*sum + share * (b.quality.*sum - a.quality.*sum);
    };
    quality = b.quality;
    quality.unlocked_s = between(&Quality::unlocked_s);
    quality.untilted_s = between(&Quality::untilted_s);
    quality.ungyro_s = between(&Quality::ungyro_s);
    quality.pressure_off = between(&Quality::pressure_off);
    quality.pressure_sigma = between(&Quality::pressure_sigma);
    // The rate is linear between nodes, and what that leaves of the turn comes evenly.
    quality.gyro_turn =
        between(&Quality::gyro_turn) + 0.5 * (a.heading_rate - b.heading_rate) * s * (1 - share);
  }
  quality.has_gyro = gyro_times_.any();
  quality.sound_share = soundShare();
  quality.heading_leaps = counters_.heading_leaps;
  for (std::size_t i = leap_times_.size(); i > 0 && leap_times_[i - 1] > utc_ns; --i) --quality.heading_leaps;
  return quality;
}

Eigen::Vector3d DeadReckoning::velocityBody() const noexcept {
  if (nodes_.empty()) return Eigen::Vector3d::Zero();
  const Node& newest = nodes_.back();
  const Eigen::Vector3d v_dvl = newest.R_odom_body.conjugate() * newest.v_dvl;
  return v_dvl - rateOfTurn(newest.utc_ns).cross(config_.T_body_dvl.translation());
}

}  // namespace fathom::nav

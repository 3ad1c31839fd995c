// Verdicts on DVL, compass and visual odometry of each step, and the weights that follow.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "recon/slam/navigation_graph.hpp"

namespace fathom::slam {
namespace {

// Of what is not believed but must hold two parts together, or tells tilt besides heading: its standard
// deviations are a hundred times as large, half a metre and ten degrees.
constexpr double kWidened = 1e-4;
constexpr double kYawUnjudged = 1.0;  // variance of a step's yaw where HeadingTrust judges it [rad^2]
// Share of a turn by which a step's way is turned in the mean: the compass may have leapt at any time of it.
constexpr double kMeanTurn = 0.5;
// A velocity that differs from the one before by twice as much as the other, and this, is the one that lies.
constexpr double kTwice = 2, kLeastChange = 0.05;  // [1], [m/s]
constexpr double kStaleVelocity_s = 10;            // older, it tells nothing of the present one

// Error of a factor as a right perturbation (rho, phi).
Vector6d perturbationOf(const RelativePose& factor, const SE3& T_from, const SE3& T_to) {
  Vector6d e = relativePoseError(factor, T_from, T_to);
  e.tail<3>() *= 2;
  return e;
}

// A way in odom's axes, level, ahead and to starboard of a heading [m].
Eigen::Vector2d level(const Eigen::Vector3d& way, double heading) {
  return Eigen::Rotation2Dd(-heading) * Eigen::Vector2d(way.head<2>());
}

}  // namespace

double NavigationGraph::distance2(const RelativePose& factor, const Matrix6d& covariance) const {
  const Vector6d e = perturbationOf(factor, solver_.pose(factor.from), solver_.pose(factor.to));
  return e.dot(covariance.ldlt().solve(e));
}

// The weights of a step's chain: what is believed has 1; of step and link one stays, widened at least.
void NavigationGraph::weigh(Frame& f) {
  const bool visual = f.link >= 0 && !f.visualLies(), dvl = f.step >= 0 && !f.dvl_lies,
             compass = f.heading.compass && !f.mixed;
  const auto set = [&](int measurement, double weight) {
    if (measurement >= 0 && solver_.measurement(measurement).weight != weight)
      (void)solver_.setWeight(measurement, weight);
  };
  set(f.step, dvl ? f.step_weight : visual ? 0 : kWidened);
  const bool joined = dvl && f.quality.seconds_unlocked == 0;
  set(f.link, visual ? 1 : joined ? 0 : kWidened);
  set(f.attitude, compass ? 1 : kWidened);
  const auto count = [](std::uint64_t& counter, bool& counted, bool lies) {
    counter += lies ? 1U : 0U;
    counter -= counted ? 1U : 0U;
    counted = lies;
  };
  count(counters_.compass_distrusted, f.counted[0], f.attitude >= 0 && !compass);
  count(counters_.visual_distrusted, f.counted[1], f.visualLies());
  count(counters_.steps_left_out, f.counted[2], f.dvl_lies);
}

StepTurns NavigationGraph::turnsOf(const Frame& from, const Frame& to) const {
  StepTurns turns;
  const double before = headingOf(from.T_odom_cam, config_.forward_in_camera);
  turns.seconds = to.quality.seconds;
  turns.compass = wrapAngle(headingOf(to.T_odom_cam, config_.forward_in_camera) - before);
  turns.compass_held = to.attitude < 0;
  turns.compass_leapt = to.leapt;
  turns.has_gyro = to.ungyro_s == 0;
  turns.gyro = to.gyro_turn;
  turns.gyro_sigma = config_.noise.gyro_walk * std::sqrt(std::max(turns.seconds, 0.0));
  turns.has_visual = seen_.linked;
  if (seen_.linked) {
    const SE3 seen = from.T_odom_cam * seen_.link.T_a_b;
    turns.visual = wrapAngle(headingOf(seen, config_.forward_in_camera) - before);
    turns.confirmed =
        seen_.confirmed || (to.quality.seconds_unlocked == 0 &&
                            linkFitsButForYaw(from, to, wrapAngle(turns.visual - turns.compass)));
    const Eigen::Vector3d down = seen.rotation().conjugate() * Eigen::Vector3d::UnitZ();
    turns.visual_sigma =
        std::sqrt(std::max(0.0, down.dot(seen_.link.covariance.bottomRightCorner<3, 3>() * down)));
  }
  return turns;
}

// Visual odometry against the DVL's step, but for yaw: its own noise, with the tilt's and depth sensor's of
// both ends. Ways are those of the DVL, which a compass that errs at the end does not swing about.
bool NavigationGraph::linkFitsButForYaw(const Frame& from, const Frame& to, double contradiction) const {
  const SensorNoise& noise = config_.noise;
  const SE3 &T_a_b = seen_.link.T_a_b, T_odom_to = dvl_.corrected(from.T_odom_cam, to.T_odom_cam);
  const double way = T_a_b.translation().norm(),
               place = std::hypot(stepSigma(way, to.quality, noise), kMeanTurn * contradiction * way);
  const Matrix6d at_dvl = perturbationAt(config_.dvl_in_camera);
  const SE3 T_odom_seen = from.T_odom_cam * T_a_b;
  // Nav's axes, in which depth and yaw are, seen from the camera, however that is mounted.
  const Eigen::Matrix3d R = T_odom_seen.matrix3();
  const double depth = std::hypot(noise.depth, to.quality.pressure_sigma),
               vertical = std::hypot(place, 2 * depth), tilt = 2 * noise.tilt;
  const Eigen::Vector3d place2(place * place, place * place, vertical * vertical),
      turn2(tilt * tilt, tilt * tilt, kYawUnjudged);
  Matrix6d spread = Matrix6d::Zero();
  spread.topLeftCorner<3, 3>() = R.transpose() * place2.asDiagonal() * R;
  spread.bottomRightCorner<3, 3>() = R.transpose() * turn2.asDiagonal() * R;
  Vector6d e = perturbationOf({0, 1, T_a_b, Matrix6d::Identity()}, from.T_odom_cam, T_odom_to);
  e.head<3>() = T_odom_seen.rotation().conjugate() *
                (T_odom_to * config_.dvl_in_camera - T_odom_seen * config_.dvl_in_camera);
  const Matrix6d seen = seen_.link.covariance + dvl_.leftOpen(T_a_b, to.range);
  const Matrix6d covariance = spread + at_dvl * seen * at_dvl.transpose();
  return e.dot(covariance.ldlt().solve(e)) <= config_.gate;
}

// Which of two that contradict each other lies, the velocity before tells: a vehicle of a hundred kilograms
// does not change it in a second. A liar that goes on and on is the other one after all.
void NavigationGraph::judgeVelocity(Frame& from, Frame& to) {
  const double elapsed = std::max(to.quality.seconds, 1e-3),
               heading = headingOf(from.T_odom_cam, config_.forward_in_camera);
  const SE3 T_odom_to = dvl_.corrected(from.T_odom_cam, to.T_odom_cam);
  // Of the DVL, as linkFitsButForYaw().
  const auto velocity = [&](const SE3& T_odom_then) {
    return level(T_odom_then * config_.dvl_in_camera - from.T_odom_cam * config_.dvl_in_camera, heading) /
           elapsed;
  };
  const Eigen::Vector2d reckoned = velocity(T_odom_to);
  const bool locked = to.quality.seconds_unlocked == 0;
  if (!seen_.linked) {
    if (locked && !counters_.dvl_lies) velocity_ = reckoned;
    return;
  }
  const Eigen::Vector2d visual = velocity(from.T_odom_cam * seen_.link.T_a_b);
  const auto learn = [&] {
    if (locked && to.heading.visual)
      (void)dvl_.add(from.T_odom_cam, to.T_odom_cam, seen_.T_a_b, seen_.link.covariance, to.quality,
                     to.range);
  };
  if (linkFitsButForYaw(from, to, 0)) {
    contradictions_ = slips_ = 0;
    if (++agreements_ >= config_.lying_after) counters_.dvl_lies = false;
    velocity_ = visual;
    learn();
    return;
  }
  ++counters_.steps_contradicted;
  agreements_ = 0;
  const double by_dvl = (reckoned - velocity_).norm(), by_visual = (visual - velocity_).norm();
  const bool known = from.quality.seconds > 0 && elapsed < kStaleVelocity_s;
  const bool slips = locked && !counters_.dvl_lies && known && slips_ < config_.lying_after &&
                     by_visual > kTwice * by_dvl + kLeastChange;
  if (slips) {
    to.link_slips = true;
    contradictions_ = 0;
    ++slips_;
    velocity_ = reckoned;
    return;
  }
  for (int k = keyframes() - 2; slips_ > 0 && has(k); --k, --slips_) {
    frames_[at(k)].link_slips = false;
    frames_[at(k)].dvl_lies = true;
    ++contradictions_;
    weigh(frames_[at(k)]);
  }
  slips_ = 0;
  to.dvl_lies = true;
  velocity_ = visual;
  learn();
  if (++contradictions_ >= config_.lying_after) counters_.dvl_lies = true;
}

void NavigationGraph::rigBeganAnew(double turn_sigma, std::int64_t since_ns, bool knocked) {
  judge();
  dvl_.rigBeganAnew(turn_sigma);
  ++rig_;
  ++curved_;
  contradictions_ = slips_ = agreements_ = 0;
  counters_.dvl_lies = false;
  const std::span<const int> all = living();
  for (std::size_t i = all.size(); i-- > 0 && frames_[at(all[i])].utc_ns >= since_ns;) {
    Frame& frame = frames_[at(all[i])];
    frame.dvl_lies = false;
    frame.link_slips = frame.link_slips || (knocked && frame.link >= 0);
    weigh(frame);
  }
}

void NavigationGraph::judge() {
  if (!seen_.waits) return;
  seen_.waits = false;
  const int newest = keyframes() - 1;
  Frame &from = frames_[at(newest - 1)], &to = frames_[at(newest)];
  const StepTurns turns = turnsOf(from, to);
  heading_.add(turns);
  to.heading.visual = heading_.verdict(newest - 1).visual;
  const double doubt = std::hypot(turns.visual_sigma, 2 * config_.noise.heading,
                                  config_.noise.deviation_turn * std::sqrt(std::abs(turns.compass)));
  if (turns.has_visual && std::abs(wrapAngle(turns.visual - turns.compass)) > config_.turned_sigmas * doubt)
    ++counters_.steps_contradicted;
  if (turns.has_gyro) {
    const double turn = wrapAngle(turns.gyro - heading_.gyroBias() * turns.seconds);
    (void)addFactor(gyroFactor(from.node, to.node, from.T_odom_cam, to.T_odom_cam, turn - turns.compass,
                               heading_.gyroSigma(turns)));
  }
  if (const double wrong = std::abs(wrapAngle(turns.visual - turns.compass));
      turns.has_visual && to.heading.visual && wrong > doubt) {
    const double way = seen_.link.T_a_b.translation().norm(),
                 sigma = stepSigma(way, to.quality, config_.noise), turned = kMeanTurn * wrong * way;
    to.step_weight = sigma * sigma / (sigma * sigma + turned * turned);
  }
  judgeVelocity(from, to);
  seen_.linked = false;
  takeVerdicts(static_cast<int>(heading_.firstChanged()) + 1);
  const bool seen = to.link >= 0 && !to.visualLies(),
             reckoned = !to.dvl_lies && !counters_.dvl_lies && to.quality.seconds_unlocked == 0;
  const bool headed = seen || turns.has_gyro || (to.heading.compass && to.attitude >= 0);
  if (!headed || !(seen || reckoned)) trouble_ns_ = to.utc_ns;
  // Where images saw it: in a turn the compass lags by many of their standard deviations.
  if (seen && solver_.startAt(to.node, solver_.pose(from.node) * seen_.link.T_a_b))
    to.known = solver_.pose(to.node);
}

// Verdicts on the heading from a keyframe on. Where the compass has another reference, the drift to the first
// one that begins there or later is loosened; readings in between, of a reference that mixes both, are not
// believed.
void NavigationGraph::takeVerdicts(int keyframe) {
  bool mixed = has(keyframe - 1) && frames_[at(keyframe - 1)].mixed;
  for (int k = keyframe; k < keyframes(); ++k) {
    if (!has(k)) continue;
    Frame& frame = frames_[at(k)];
    const bool had_leapt = frame.heading.restarts;
    frame.heading = heading_.verdict(k - 1);
    if (!frame.leapt && frame.heading.restarts && !had_leapt) ++counters_.compass_jumps;
    if (!frame.leapt && !frame.heading.restarts && had_leapt) --counters_.compass_jumps;
    mixed = mixed || frame.heading.restarts;
    if (frame.heading.restarts) jumped_ns_ = std::max(jumped_ns_, frame.utc_ns);
    if (frame.drift >= 0) {
      if (const double weight = mixed ? kWidened : 1; solver_.measurement(frame.drift).weight != weight)
        (void)solver_.setWeight(frame.drift, weight);
      mixed = false;
    }
    frame.mixed = mixed;
    weigh(frame);
  }
  jump_waits_ = mixed;
}

}  // namespace fathom::slam

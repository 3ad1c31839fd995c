#include "sim/vehicle/vehicle.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "recon/geometry/se3.hpp"
#include "sim/scenario/random.hpp"

namespace fathom::sim {
namespace {

constexpr double kStep = 0.1;      // of the guidance and between the spline's knots [s]
constexpr double kAtDepth = 0.15;  // the dive or ascent is over this near to the wanted depth [m]
constexpr double kAtRest = 0.01;   // [m/s]
constexpr double kLongestPhase =
    40000.0;  // limit for a dive, a survey or an ascent, against endless plans [s]

enum class Phase { kFloatBefore, kDive, kSurvey, kAscend, kFloatAfter, kOver };

// Random motion of the hull: angles, and deviation from the planned line.
struct Motion {
  Motion(const VehicleConfig& c, std::uint64_t seed) {
    Random random(seed, "motion");
    roll = SmoothNoise(random, c.roll_sigma, c.shortest_roll_period_s, c.longest_roll_period_s);
    pitch = SmoothNoise(random, c.pitch_sigma, c.shortest_roll_period_s, c.longest_roll_period_s);
    heading = SmoothNoise(random, c.heading_sigma, 8.0, 40.0);
    north = SmoothNoise(random, c.cross_track_sigma_m, 25.0, 90.0);
    east = SmoothNoise(random, c.cross_track_sigma_m, 25.0, 90.0);
  }
  SmoothNoise roll, pitch, heading, north, east;
};

class Guidance {
 public:
  Guidance(const SurveyPlan& plan, const VehicleConfig& config, const SeafloorDepth& seafloor,
           std::uint64_t seed, double longest_survey_s)
      : config_(config),
        seafloor_(seafloor),
        longest_survey_(longest_survey_s),
        path_(surveyLines(plan), config.turn_radius_m),
        motion_(config, seed),
        follower_(config.follower, config.float_depth_m, shallowestAhead()),
        hull_heading_(path_.at(0).heading),
        last_depth_(follower_.depth()) {}

  Trajectory run() {
    while (phase_ != Phase::kOver) {
      knots_.push_back(knot());
      last_depth_ = follower_.depth();
      step();
      time_ += kStep;
      phase_time_ += kStep;
      if (phase_time_ > kLongestPhase) throw std::runtime_error("the vehicle's plan does not come to an end");
    }
    // The spline begins and ends two knots inside: repeat the ends.
    knots_.insert(knots_.begin(), knots_.front());
    knots_.push_back(knots_.back());
    knots_.push_back(knots_.back());
    return {kStep, std::move(knots_), survey_begin_, survey_end_, dive_begin_, surfaced_};
  }

 private:
  double shallowestAhead() const {
    constexpr double kLookStep = 0.25;  // between the forward altimeter's soundings [m]
    const SurveyPath::Point p = path_.at(arc_);
    const Eigen::Vector2d ahead(std::cos(p.heading), std::sin(p.heading));
    double shallowest = seafloor_(p.position.x(), p.position.y());
    for (int step = 1; step * kLookStep <= config_.look_ahead_m; ++step) {
      const double d = step * kLookStep;
      const Eigen::Vector2d place =
          path_.at(arc_ + d).turning ? path_.at(arc_ + d).position : Eigen::Vector2d(p.position + d * ahead);
      shallowest = std::min(shallowest, seafloor_(place.x(), place.y()));
    }
    return shallowest;
  }

  Trajectory::Knot knot() const {
    const SurveyPath::Point p = path_.at(arc_);
    const double climb = std::atan2((last_depth_ - follower_.depth()) / kStep, std::max(speed_, 0.1));
    Trajectory::Knot k;
    k << p.position.x() + motion_.north.at(time_), p.position.y() + motion_.east.at(time_), follower_.depth(),
        motion_.roll.at(time_), motion_.pitch.at(time_) + config_.climb_pitch * climb,
        hull_heading_ + motion_.heading.at(time_) + config_.crab;
    for (const Collision& c : config_.collisions) {
      const double since = time_ - c.at_s;
      if (since < 0) continue;
      // Displaced within tenths of a second, back within some time constants.
      constexpr double kBlow = 0.2;  // [s]
      const double thrown = (1 - std::exp(-since / kBlow)) * std::exp(-since / c.recovers_s);
      k(0) -= c.throw_m * thrown * std::sin(hull_heading_);
      k(1) += c.throw_m * thrown * std::cos(hull_heading_);
      k(3) += 0.3 * c.turn * thrown;
      k(5) += c.turn * thrown;
    }
    return k;
  }

  void enter(Phase phase) {
    phase_ = phase;
    phase_time_ = 0;
  }

  void step() {
    switch (phase_) {
      case Phase::kFloatBefore:
        if (phase_time_ >= config_.float_s) {
          dive_begin_ = time_;
          enter(Phase::kDive);
        }
        break;
      case Phase::kDive:
        follower_.stepTowards(kStep, follower_.wantedDepth(), config_.dive_rate_mps);
        if (std::abs(follower_.wantedDepth() - follower_.depth()) < kAtDepth) {
          survey_begin_ = time_ + kStep;
          enter(Phase::kSurvey);
        }
        break;
      case Phase::kSurvey:
        stepSurvey();
        break;
      case Phase::kAscend:
        speed_ = std::max(0.0, speed_ - config_.acceleration_mps2 * kStep);
        advance();
        follower_.stepTowards(kStep, config_.float_depth_m, config_.dive_rate_mps);
        if (std::abs(follower_.depth() - config_.float_depth_m) < kAtDepth) {
          surfaced_ = time_ + kStep;
          enter(Phase::kFloatAfter);
        }
        break;
      case Phase::kFloatAfter:
        follower_.stepTowards(kStep, config_.float_depth_m, config_.dive_rate_mps);
        if (phase_time_ >= config_.float_s) enter(Phase::kOver);
        break;
      case Phase::kOver:
        break;
    }
  }

  void stepSurvey() {
    const double seafloor = shallowestAhead();
    follower_.step(kStep, seafloor - path_.at(arc_).rise);
    const double clearance = seafloor - follower_.depth();
    const double step = config_.acceleration_mps2 * kStep;
    speed_ += std::clamp(wantedSpeed(clearance) - speed_, -step, step);
    advance();
    const bool done = arc_ >= path_.length() - kAtRest || phase_time_ >= longest_survey_ - 0.5 * kStep;
    if (done) {
      survey_end_ = time_ + kStep;
      enter(Phase::kAscend);
    }
  }

  void advance() {
    arc_ = std::min(arc_ + speed_ * kStep, path_.length());
    hull_heading_ +=
        (path_.at(arc_).heading - hull_heading_) * (1.0 - std::exp(-kStep / config_.heading_lag_s));
  }

  // Cruising speed, reduced before a turn, the end of the plan and rising seafloor.
  double wantedSpeed(double clearance) const {
    const double a = config_.acceleration_mps2;
    const double turn_speed = std::min(config_.speed_mps, config_.turn_rate * config_.turn_radius_m);
    for (const Hover& hover : config_.hovers)
      if (time_ >= hover.at_s && time_ < hover.at_s + hover.for_s) return 0;
    double wanted = std::min(config_.speed_mps,
                             std::sqrt(turn_speed * turn_speed + 2.0 * a * path_.distanceToTurn(arc_)));
    // A least speed at the end of the plan, so that it is reached in finite time.
    constexpr double kCreep = 0.1;  // [m/s]
    wanted = std::min(wanted, std::sqrt(kCreep * kCreep + 2.0 * a * std::max(0.0, path_.length() - arc_)));
    const double slow_from = 0.5 * (config_.min_altitude_m + config_.follower.altitude_m);
    const double margin = (clearance - config_.min_altitude_m) / (slow_from - config_.min_altitude_m);
    return wanted * std::clamp(margin, 0.0, 1.0);
  }

  const VehicleConfig& config_;
  const SeafloorDepth& seafloor_;
  double longest_survey_;
  SurveyPath path_;
  Motion motion_;
  double arc_ = 0;    // along the path [m]
  double speed_ = 0;  // [m/s]
  BottomFollower follower_;
  double hull_heading_;
  double last_depth_;
  Phase phase_ = Phase::kFloatBefore;
  double time_ = 0, phase_time_ = 0;
  double dive_begin_ = 0, survey_begin_ = 0, survey_end_ = 0, surfaced_ = 0;
  std::vector<Trajectory::Knot> knots_;
};

}  // namespace

BottomFollower::BottomFollower(const BottomFollowerConfig& config, double depth_m, double seafloor_depth_m)
    : config_(config), depth_(depth_m), seafloor_(seafloor_depth_m) {}

void BottomFollower::step(double dt_s, double seafloor_depth_m) {
  const bool rises = seafloor_depth_m < seafloor_;
  const double lag = rises ? config_.climb_lag_s : config_.descent_lag_s;
  seafloor_ += (seafloor_depth_m - seafloor_) * (1.0 - std::exp(-dt_s / lag));
  move(dt_s, wantedDepth(), config_.climb_rate_mps, config_.descent_rate_mps);
}

void BottomFollower::stepTowards(double dt_s, double depth_m, double rate_mps) {
  move(dt_s, depth_m, rate_mps, rate_mps);
}

void BottomFollower::move(double dt_s, double wanted_depth_m, double up_rate_mps, double down_rate_mps) {
  const double wanted =
      std::clamp(config_.gain_per_s * (wanted_depth_m - depth_), -up_rate_mps, down_rate_mps);
  const double step = config_.acceleration_mps2 * dt_s;
  speed_ += std::clamp(wanted - speed_, -step, step);
  depth_ += speed_ * dt_s;
}

Trajectory::Trajectory(double knot_interval_s, std::vector<Knot> knots, double survey_begin_s,
                       double survey_end_s, double dive_begin_s, double surfaced_s)
    : interval_(knot_interval_s),
      knots_(std::move(knots)),
      survey_begin_(survey_begin_s),
      survey_end_(survey_end_s),
      dive_begin_(dive_begin_s),
      surfaced_(surfaced_s) {
  if (knots_.size() < 4) throw std::invalid_argument("a trajectory needs at least four knots");
}

double Trajectory::duration() const {
  return interval_ * static_cast<double>(knots_.size() - 3);
}

void Trajectory::evaluate(double time_s, Knot& value, Knot& derivative) const {
  const double x = std::clamp(time_s, 0.0, duration()) / interval_;
  const auto segment = std::min(static_cast<std::size_t>(x), knots_.size() - 4);
  const double u = x - static_cast<double>(segment);
  const Knot &a = knots_[segment], &b = knots_[segment + 1], &c = knots_[segment + 2],
             &d = knots_[segment + 3];
  const double v = 1.0 - u;
  value = (v * v * v * a + (3 * u * u * u - 6 * u * u + 4) * b +
           (-3 * u * u * u + 3 * u * u + 3 * u + 1) * c + u * u * u * d) /
          6.0;
  derivative =
      (-v * v * a + (3 * u * u - 4 * u) * b + (-3 * u * u + 2 * u + 1) * c + u * u * d) / (2.0 * interval_);
}

Trajectory::State Trajectory::at(double time_s) const {
  Knot value, rate;
  evaluate(time_s, value, rate);
  State state;
  state.T_nav_body = SE3::fromEuler(value[3], value[4], value[5], value.head<3>());
  state.velocity_nav = rate.head<3>();
  const double sr = std::sin(value[3]), cr = std::cos(value[3]), sp = std::sin(value[4]),
               cp = std::cos(value[4]);
  state.rates_body = {rate[3] - rate[5] * sp, rate[4] * cr + rate[5] * sr * cp,
                      -rate[4] * sr + rate[5] * cr * cp};
  return state;
}

SE3 Trajectory::poseAt(double time_s) const {
  return at(time_s).T_nav_body;
}

Trajectory simulateVehicle(const SurveyPlan& plan, const VehicleConfig& config, const SeafloorDepth& seafloor,
                           std::uint64_t seed, double longest_survey_s) {
  return Guidance(plan, config, seafloor, seed, longest_survey_s).run();
}

}  // namespace fathom::sim

#include "sim/vehicle/trajectory.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace fathom::sim {

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

}  // namespace fathom::sim

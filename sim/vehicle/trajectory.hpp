#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/se3.hpp"

namespace fathom::sim {

// True pose of the vehicle over time, with continuous acceleration: a uniform cubic B-spline of north, east,
// depth and the Euler angles; its control points are the steps of the simulated guidance.
class Trajectory {
 public:
  // north, east, depth [m], roll, pitch, yaw [rad] (yaw not wrapped).
  using Knot = Eigen::Matrix<double, 6, 1>;

  struct State {
    SE3 T_nav_body;
    Eigen::Vector3d velocity_nav = Eigen::Vector3d::Zero();  // over ground [m/s]
    Eigen::Vector3d rates_body = Eigen::Vector3d::Zero();    // angular velocity in body [rad/s]
  };

  // Times in s since the mission's start. Throws std::invalid_argument for fewer than four knots.
  Trajectory(double knot_interval_s, std::vector<Knot> knots, double survey_begin_s, double survey_end_s,
             double dive_begin_s, double surfaced_s);

  [[nodiscard]] State at(double time_s) const;  // clamped to [0, duration()]
  [[nodiscard]] SE3 poseAt(double time_s) const;
  [[nodiscard]] double duration() const;  // [s]
  // The vehicle is at survey depth and on the plan's lines from surveyBegin() to surveyEnd(), at the surface
  // before diveBegin() and from surfaced() on.
  [[nodiscard]] double surveyBegin() const { return survey_begin_; }
  [[nodiscard]] double surveyEnd() const { return survey_end_; }
  [[nodiscard]] double diveBegin() const { return dive_begin_; }
  [[nodiscard]] double surfaced() const { return surfaced_; }

 private:
  // Value, first derivative of the spline.
  void evaluate(double time_s, Knot& value, Knot& derivative) const;

  double interval_;
  std::vector<Knot> knots_;
  double survey_begin_, survey_end_, dive_begin_, surfaced_;
};

}  // namespace fathom::sim

#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "sim/sensors/sensors.hpp"
#include "sim/vehicle/vehicle.hpp"

namespace fathom::sim {

inline constexpr double kSeafloor = 12.0;  // depth of the flat test seafloor [m]

inline std::optional<double> castFlat(const Eigen::Vector3d& from, const Eigen::Vector3d& direction) {
  if (direction.z() <= 0) return std::nullopt;
  return (kSeafloor - from.z()) / direction.z();
}

// A dive of a few minutes over a flat seafloor.
class SensorTest : public ::testing::Test {
 protected:
  static SurveyPlan plan() {
    SurveyPlan p;
    p.lines = 6;
    p.line_length = 12;
    p.cross_lines = 2;
    return p;
  }
  const Trajectory trajectory = simulateVehicle(
      plan(), VehicleConfig(), [](double, double) { return kSeafloor; }, 2);
  SensorWorld world(std::uint64_t seed = 7) const {
    return {trajectory,
            castFlat,
            {-0.4089, 2.6519},
            1772330400000000000,
            0.18,
            SE3::fromEuler(0.01, -0.02, 0.03, {-0.35, 0.0, 0.22}),
            SE3::fromEuler(0, 0, 0, {0.1, 0.0, -0.4}),
            SE3::fromEuler(0, 0, 0, {0.2, 0.1, -0.1}),
            SE3::fromEuler(0.003, 0.005, -0.009, {0.6, 0, -0.2}),
            seed};
  }
  double timeOf(std::int64_t utc_ns) const {
    return static_cast<double>(utc_ns - 1772330400000000000) * 1e-9;
  }
};

struct Statistics {
  double sum = 0, squares = 0;
  int count = 0;
  void add(double v) {
    sum += v;
    squares += v * v;
    ++count;
  }
  double mean() const { return sum / count; }
  double sigma() const { return std::sqrt(squares / count - mean() * mean()); }
};

}  // namespace fathom::sim

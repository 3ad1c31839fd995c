#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "realtime/base/units.hpp"

namespace fathom::sim {

struct WavesConfig {
  double height_m = 0.0;                    // significant: four standard deviations of the surface; 0: none
  double period_s = 8.0;                    // of the spectrum's peak
  double towards = degreesToRadians(90);    // where they run to, from north to east [rad]
  double spreading = degreesToRadians(15);  // standard deviation of the directions about it [rad]
};

// Surface waves of a sea: linear (Airy) theory in water of finite depth (Dean and Dalrymple 1991, ch. 3),
//   eta = sum a cos(omega t - k . x + phase),   omega^2 = g k tanh(k h),
// with components of equal variance: a JONSWAP spectrum (Hasselmann et al. 1973; peak enhancement 3.3) is
// divided into parts of equal variance, and each frequency is drawn from its part. x: north and east in nav
// [m]; t: since the mission's start [s]. Draws from the stream "waves".
class Waves {
 public:
  // `water_depth_m`: of the dispersion relation.
  Waves(const WavesConfig& config, std::uint64_t seed, double water_depth_m);

  [[nodiscard]] bool calm() const { return components_.empty(); }
  // Height of the surface over that of the still sea [m].
  [[nodiscard]] double heightAt(const Eigen::Vector2d& place, double time_s) const;
  // Dynamic pressure at a depth below the still sea, as a height of water [m]: each component times
  // cosh(k (h - depth)) / cosh(k h), h the water's depth there.
  [[nodiscard]] double pressureAt(const Eigen::Vector3d& place, double water_depth_m, double time_s) const;
  // Displacement of the surface's water from its place at rest, north and east [m].
  [[nodiscard]] Eigen::Vector2d shiftAt(const Eigen::Vector2d& place, double time_s) const;

 private:
  struct Component {
    double amplitude, rate, phase;  // [m], [rad/s], [rad]
    Eigen::Vector2d number;         // k [rad/m]
    [[nodiscard]] double phaseAt(const Eigen::Vector2d& place, double time_s) const {
      return rate * time_s - number.dot(place) + phase;
    }
  };
  double water_depth_m_;
  std::vector<Component> components_;
};

}  // namespace fathom::sim

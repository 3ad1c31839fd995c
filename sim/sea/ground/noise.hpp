#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "realtime/base/numbers/hash64.hpp"

namespace fathom::sim {

// A random stream that is a function of a seed and an object's number.
class GroundRandom {
 public:
  GroundRandom(std::uint64_t seed, std::uint64_t object) : state_(hash64(seed, object)) {}
  std::uint64_t bits() { return state_ = hash64(state_); }
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1p-53; }  // [0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }

 private:
  std::uint64_t state_;
};

// Hermite's step: 0 where x is `low`, 1 where it is `high`, with zero slope there and beyond.
template <typename Real>
[[nodiscard]] Real smoothstep(Real low, Real high, Real x) {
  const Real t = std::clamp((x - low) / (high - low), Real{0}, Real{1});
  return t * t * (3 - 2 * t);
}

// Gradient noise (Perlin 2002) over space, zero mean, standard deviation about 0.25, features of about one
// unit.
[[nodiscard]] double gradientNoise(std::uint64_t seed, double x, double y, double z);

// Sum of octaves, each half as long and `gain` as strong, scaled to standard deviation 1. `wavelength`: of
// the first octave, in the unit of the point.
struct FractalNoise {
  std::uint64_t seed = 0;
  double wavelength = 1.0;
  int octaves = 3;
  double gain = 0.5;
  [[nodiscard]] double operator()(double x, double y, double z = 0.0) const;
  [[nodiscard]] double operator()(const Eigen::Vector3d& p) const { return (*this)(p.x(), p.y(), p.z()); }
};

// White noise on a cubic lattice, interpolated linearly: the fast noise of the renderer's fine texture. Unit
// standard deviation over space, features of about two lattice steps, period kSize steps.
class NoiseVolume {
 public:
  static constexpr int kSize = 64;

  explicit NoiseVolume(std::uint64_t seed);
  // Value at a point in lattice steps; its gradient (per step) goes to `gradient`.
  [[nodiscard]] float sample(const Eigen::Vector3f& p, Eigen::Vector3f& gradient) const;

 private:
  std::vector<std::int8_t> values_;  // normal deviates over kScale
};

}  // namespace fathom::sim

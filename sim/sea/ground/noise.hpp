#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace fathom::sim {

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

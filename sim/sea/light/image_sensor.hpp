#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "sim/sea/optics.hpp"

namespace fathom::sim {

// A normal deviate (mean 0, variance 1) that is a function of a hash.
class NormalTable {
 public:
  NormalTable();
  [[nodiscard]] float operator()(std::uint64_t hash) const;

 private:
  std::vector<float> quantiles_;
};

// Channel of a Bayer RGGB pixel: 0 red, 1 green, 2 blue.
[[nodiscard]] constexpr int bayerChannel(int x, int y) {
  return (x & 1) + (y & 1);
}

// Quantises electrons: value = (electrons + noise) / full well * (2^bits - 1) + black level, with noise of
// variance electrons (shot noise, normal limit of Poisson's) + read noise squared; rounded and clamped.
class ImageSensor {
 public:
  explicit ImageSensor(const ImageSensorConfig& config);
  void expose(const float* electrons, int width, int height, std::uint64_t noise_seed,
              std::uint16_t* out) const;

 private:
  ImageSensorConfig config_;
  NormalTable normal_;
};

}  // namespace fathom::sim

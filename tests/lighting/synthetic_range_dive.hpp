#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/lighting/range_lattice.hpp"

namespace fathom::test {

inline constexpr int kRangeWidth = 160, kRangeHeight = 120;  // [px]

// Synthetic pictures of a level floor by one lamp 0.6 m ahead of the camera, through water that takes 0.25 a
// metre and sends a veil back: light that changes its pattern with the altitude.
class SyntheticRangeDive {
 public:
  explicit SyntheticRangeDive(unsigned seed) : random_(seed) {}

  // Range along a pixel's ray [m] from `altitude`.
  static double range(int x, int y, double altitude) {
    return altitude * std::sqrt(1 + u(x) * u(x) + v(y) * v(y));
  }
  static lighting::RangeLattice ranges(double altitude) {
    lighting::RangeLattice lattice;
    for (int j = 0; j < lighting::RangeLattice::kRows; ++j)
      for (int i = 0; i < lighting::RangeLattice::kColumns; ++i)
        lattice.path[static_cast<std::size_t>(j * lighting::RangeLattice::kColumns + i)] =
            static_cast<float>(range(i * (kRangeWidth - 1) / (lighting::RangeLattice::kColumns - 1),
                                     j * (kRangeHeight - 1) / (lighting::RangeLattice::kRows - 1), altitude));
    return lattice;
  }
  // Light that a floor of reflectance 1 sends back, in parts of full scale.
  static double light(int x, int y, double altitude) {
    const double across = u(x) * altitude, along = v(y) * altitude + 0.6;
    const double lamp = std::sqrt(altitude * altitude + across * across + along * along);
    return 2.4 * altitude / (lamp * lamp * lamp) * std::exp(-0.25 * (lamp + range(x, y, altitude)));
  }
  static double veil(double altitude) { return 0.004 * (1 - std::exp(-altitude)); }

  // A floor of patches with a reflectance of mean 0.6 and a standard deviation of 30 % of it.
  std::vector<std::uint16_t> textured(double altitude) {
    constexpr int kPatch = 5;  // [px]
    std::normal_distribution<double> reflectance(0.6, 0.18);
    std::vector<double> floor((kRangeWidth / kPatch + 2) * (kRangeHeight / kPatch + 2));
    for (double& r : floor) r = std::max(reflectance(random_), 0.05);
    const int shift = static_cast<int>(random_() % kPatch);
    return picture(altitude, [&](int x, int y) {
      return floor[static_cast<std::size_t>((y + shift) / kPatch * (kRangeWidth / kPatch + 2) +
                                            (x + shift) / kPatch)];
    });
  }
  std::vector<std::uint16_t> even(double altitude) {
    return picture(altitude, [](int, int) { return 0.6; });
  }
  std::mt19937& random() { return random_; }

  static ImageView view(const std::vector<std::uint16_t>& picture) {
    return {picture.data(),     kRangeWidth, kRangeHeight, kRangeWidth * sizeof(std::uint16_t),
            PixelFormat::kMono, 12};
  }

 private:
  static double u(int x) { return (x - 0.5 * (kRangeWidth - 1)) / 130; }  // 63 deg wide
  static double v(int y) { return (y - 0.5 * (kRangeHeight - 1)) / 130; }

  template <typename Reflectance>
  std::vector<std::uint16_t> picture(double altitude, Reflectance reflectance) {
    std::normal_distribution<double> noise(0.0, 0.001);
    std::vector<std::uint16_t> out;
    for (int y = 0; y < kRangeHeight; ++y)
      for (int x = 0; x < kRangeWidth; ++x) {
        const double value = light(x, y, altitude) * reflectance(x, y) + veil(altitude) + noise(random_);
        out.push_back(static_cast<std::uint16_t>(std::lround(4095 * std::clamp(value, 0.0, 1.0))));
      }
    return out;
  }

  std::mt19937 random_;
};

}  // namespace fathom::test

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/range_lattice.hpp"

namespace fathom::test {

// Synthetic images of a floor of patches under one strobe, in all formats, and statistics of
// corrected images.

inline constexpr int kStrobeWidth = 160, kStrobeHeight = 120;  // [px]
// A real camera's image is eight times as wide: the lattice is finer by as much as the images are smaller.
inline constexpr lighting::LightingConfig kStrobeConfig{.grid = 4};

// Strobe falling off from the upper left, strongly: 1 there, about 0.15 in the far corner.
inline double strobe(int x, int y) {
  const double dx = (x - 0.3 * kStrobeWidth) / kStrobeWidth, dy = (y - 0.3 * kStrobeHeight) / kStrobeHeight;
  return 1.0 / (1.0 + 6.0 * (dx * dx + dy * dy));
}

// Light of the three colours that comes back through the water.
inline constexpr std::array<double, 3> kWater = {0.12, 0.5, 0.7};

inline int colourAt(int x, int y) {
  return y % 2 == 0 ? (x % 2 == 0 ? 0 : 1) : (x % 2 == 0 ? 1 : 2);
}

struct StrobePicture {
  PixelFormat format = PixelFormat::kMono;
  int bits = 12;
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint16_t> words;
  [[nodiscard]] ImageView view() const {
    const std::size_t samples = kStrobeWidth * (format == PixelFormat::kRgb ? 3U : 1U);
    if (bits == 8) return {bytes.data(), kStrobeWidth, kStrobeHeight, samples, format, bits};
    return {words.data(), kStrobeWidth, kStrobeHeight, samples * 2, format, bits};
  }
};

// Pictures of a floor of random patches (sigma 30 % of the mean) moved past the camera.
class SyntheticStrobeDive {
 public:
  SyntheticStrobeDive(PixelFormat format, int bits) : format_(format), bits_(bits) {}

  StrobePicture next() {
    constexpr int kPatch = 5;  // [px]
    std::normal_distribution<double> reflectance(1.0, 0.3), noise(0.0, 0.003);
    std::vector<double> floor((kStrobeWidth / kPatch + 2) * (kStrobeHeight / kPatch + 2));
    for (double& r : floor) r = std::max(reflectance(random_), 0.0);
    const int shift = static_cast<int>(random_() % kPatch);
    StrobePicture picture{format_, bits_, {}, {}};
    const int channels = format_ == PixelFormat::kRgb ? 3 : 1;
    const double full = (1 << bits_) - 1;
    for (int y = 0; y < kStrobeHeight; ++y)
      for (int x = 0; x < kStrobeWidth; ++x)
        for (int c = 0; c < channels; ++c) {
          const double r = floor[static_cast<std::size_t>((y + shift) / kPatch * (kStrobeWidth / kPatch + 2) +
                                                          (x + shift) / kPatch)];
          const int colour = format_ == PixelFormat::kBayerRggb ? colourAt(x, y) : c;
          const double water = format_ == PixelFormat::kMono ? 0.5 : kWater[static_cast<std::size_t>(colour)];
          double value = water * strobe(x, y) * r + noise(random_);
          if (hot_ && x >= 70 && x < 90 && y >= 50 && y < 70 && random_() % 3 == 0) value = 1.0;
          const auto sample = std::lround(std::clamp(value, 0.0, 1.0) * full);
          if (bits_ == 8)
            picture.bytes.push_back(static_cast<std::uint8_t>(sample));
          else
            picture.words.push_back(static_cast<std::uint16_t>(sample));
        }
    return picture;
  }
  void setHot(bool hot) { hot_ = hot; }

 private:
  PixelFormat format_;
  int bits_;
  bool hot_ = false;  // one third of the samples of a central square are saturated
  std::mt19937 random_{5};
};

struct StrobeBox {
  int x0, y0, x1, y1;
};

// Mean and standard deviation, in parts of full scale, of corrected samples in a box for which
// `wanted(x, y)`.
template <typename Wanted>
std::array<double, 2> statistics(const std::vector<std::vector<std::uint8_t>>& images, const StrobeBox& box,
                                 Wanted wanted, int channels = 1, int channel = 0) {
  double n = 0, sum = 0, squares = 0;
  for (const auto& image : images)
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x) {
        if (!wanted(x, y)) continue;
        const double v = image[static_cast<std::size_t>((y * kStrobeWidth + x) * channels + channel)] / 255.0;
        n += 1, sum += v, squares += v * v;
      }
  return {sum / n, std::sqrt(squares / n - sum * sum / n / n)};
}

inline constexpr auto kEveryPixel = [](int, int) { return true; };
inline constexpr std::array<StrobeBox, 5> kCornersAndCentre = {
    {{0, 0, 30, 30}, {130, 0, 160, 30}, {0, 90, 30, 120}, {130, 90, 160, 120}, {65, 45, 95, 75}}};

// Learns `learnt` pictures and corrects `corrected` others.
inline std::vector<std::vector<std::uint8_t>> correctDive(SyntheticStrobeDive& dive, PixelFormat format,
                                                          int bits, int learnt, int corrected) {
  lighting::LightingModel model(kStrobeWidth, kStrobeHeight, format, bits, kStrobeConfig);
  for (int i = 0; i < learnt; ++i) model.add(dive.next().view());
  std::vector<std::vector<std::uint8_t>> images;
  for (int i = 0; i < corrected; ++i) {
    images.emplace_back(kStrobeWidth * kStrobeHeight * (format == PixelFormat::kRgb ? 3 : 1));
    model.correct(dive.next().view(), images.back().data());
  }
  return images;
}

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

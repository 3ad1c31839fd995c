#include "sim/sea/light/image_sensor.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/sea/ground/noise.hpp"

namespace fathom::sim {
namespace {

constexpr int kQuantileBits = 12;
constexpr std::size_t kQuantiles = std::size_t{1} << kQuantileBits;

double normalQuantile(double probability) {
  double low = -9, high = 9;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (0.5 * std::erfc(-middle / std::numbers::sqrt2) < probability ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

NormalTable::NormalTable() : quantiles_(kQuantiles + 1) {
  const double end = 0.25 / kQuantiles;  // stands for the tails, 3.8 sigma
  for (std::size_t i = 0; i <= kQuantiles; ++i)
    quantiles_[i] =
        static_cast<float>(normalQuantile(std::clamp(static_cast<double>(i) / kQuantiles, end, 1 - end)));
  // Lines between quantiles do not keep the variance by themselves.
  double variance = 0;
  for (std::size_t i = 0; i < kQuantiles; ++i) {
    const double a = quantiles_[i], b = quantiles_[i + 1];
    variance += (a * a + a * b + b * b) / 3 / kQuantiles;
  }
  for (float& q : quantiles_) q = static_cast<float>(q / std::sqrt(variance));
}

float NormalTable::operator()(std::uint64_t hash) const {
  const std::size_t index = hash >> (64 - kQuantileBits);
  const float fraction = static_cast<float>((hash >> 20) & 0xFFFFFF) * 0x1p-24F;
  return quantiles_[index] + fraction * (quantiles_[index + 1] - quantiles_[index]);
}

ImageSensor::ImageSensor(const ImageSensorConfig& config) : config_(config) {}

void ImageSensor::expose(const float* electrons, int width, int height, std::uint64_t noise_seed,
                         std::uint16_t* out) const {
  const auto top = static_cast<float>((1 << config_.bits) - 1);
  const auto gain = static_cast<float>(top / config_.full_well_electrons);
  const auto black = static_cast<float>(config_.black_level * top);
  const auto read_variance = static_cast<float>(config_.read_noise_electrons * config_.read_noise_electrons);
  const std::uint64_t stream = hash64(noise_seed);
  oneapi::tbb::parallel_for(0, height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const std::size_t i =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
      const float noise = std::sqrt(electrons[i] + read_variance) * normal_(hash64(stream ^ i));
      const float value = (electrons[i] + noise) * gain + black;
      out[i] = static_cast<std::uint16_t>(std::clamp(value + 0.5F, 0.0F, top));
    }
  });
}

}  // namespace fathom::sim

#include "firmware_if/predive/image_quality.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace fathom::io {
namespace {

constexpr double kDark = 0.02, kSaturated = 0.99;
constexpr int kLineStep = 4;           // lines looked at: every fourth, some 600 of an image of 1.4 Mpx
constexpr double kOverNoise = 10;      // slopes of edges against that of noise
constexpr double kLeastSlope = 0.004;  // of full scale a pixel: a grey level of 8 bits
constexpr double kSharpest = 0.1;      // share of the edges that counts
constexpr std::size_t kMaxEdges = 200'000;

// Grey levels of full scale, one a pixel; a Bayer image one a block of 2 x 2.
struct Grey {
  int width = 0, height = 0;
  std::vector<float> at;
};

double sampleAt(const ImageView& image, int x, int y, int channel, int channels) {
  const auto* row = static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(y) * image.stride;
  const int i = x * channels + channel;
  if (image.bits == 8) return row[i] / 255.0;
  const double full = static_cast<double>((1 << image.bits) - 1);
  return std::min(1.0, reinterpret_cast<const std::uint16_t*>(row)[i] / full);
}

Grey readGrey(const ImageView& image, ImageQuality& quality) {
  const bool bayer = image.format == PixelFormat::kBayerRggb;
  const int channels = image.format == PixelFormat::kRgb ? 3 : 1, step = bayer ? 2 : 1;
  Grey grey;
  grey.width = image.width / step;
  grey.height = image.height / step;
  grey.at.resize(static_cast<std::size_t>(grey.width) * static_cast<std::size_t>(grey.height));
  double sum = 0, dark = 0, saturated = 0, count = 0;
  for (int y = 0; y < grey.height; ++y) {
    for (int x = 0; x < grey.width; ++x) {
      double mean = 0;
      for (int dy = 0; dy < step; ++dy)
        for (int dx = 0; dx < step; ++dx)
          for (int channel = 0; channel < channels; ++channel) {
            const double value = sampleAt(image, x * step + dx, y * step + dy, channel, channels);
            mean += value;
            dark += value < kDark ? 1 : 0;
            saturated += value >= kSaturated ? 1 : 0;
            ++count;
          }
      sum += mean;
      grey.at[static_cast<std::size_t>(y) * static_cast<std::size_t>(grey.width) +
              static_cast<std::size_t>(x)] = static_cast<float>(mean / (step * step * channels));
    }
  }
  if (count > 0) {
    quality.mean = sum / count;
    quality.dark_share = dark / count;
    quality.saturated_share = saturated / count;
  }
  return grey;
}

// Slope of the noise: the median of second differences, which edges and shading hardly touch.
double noiseSlope(const Grey& grey) {
  std::vector<float> second;
  for (int y = 0; y < grey.height; y += 2 * kLineStep) {
    const float* row = grey.at.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(grey.width);
    for (int x = 1; x + 1 < grey.width; x += 2)
      second.push_back(std::abs(row[x - 1] - 2 * row[x] + row[x + 1]));
  }
  if (second.empty()) return 0;
  const auto middle = second.begin() + static_cast<std::ptrdiff_t>(second.size() / 2);
  std::nth_element(second.begin(), middle, second.end());
  // |a - 2 b + c| of white noise has the median 0.6745 sqrt(6) sigma; a central difference sqrt(1/2) sigma.
  return *middle / (0.6745 * std::sqrt(6.0)) * std::sqrt(0.5);
}

// Widths of the edges along one line of `count` levels, `stride` apart.
void addEdges(const float* line, int count, std::size_t stride, double least_slope,
              std::vector<double>& widths) {
  const auto level = [&](int i) { return static_cast<double>(line[static_cast<std::size_t>(i) * stride]); };
  const auto slope = [&](int i) { return (level(i + 1) - level(i - 1)) / 2; };
  for (int i = 2; i + 2 < count; ++i) {
    const double here = slope(i), size = std::abs(here);
    if (size < least_slope || size < std::abs(slope(i - 1)) || size <= std::abs(slope(i + 1))) continue;
    const double sign = here > 0 ? 1 : -1;
    int from = i, to = i;
    while (from > 0 && sign * (level(from) - level(from - 1)) > 0) --from;
    while (to + 1 < count && sign * (level(to + 1) - level(to)) > 0) ++to;
    if (widths.size() < kMaxEdges) widths.push_back(sign * (level(to) - level(from)) / size);
    i = std::max(i, to - 1);
  }
}

}  // namespace

ImageQuality measureImage(const ImageView& image) {
  ImageQuality quality;
  if (image.empty()) return quality;
  const Grey grey = readGrey(image, quality);
  const double least_slope = std::max(kLeastSlope, kOverNoise * noiseSlope(grey));
  std::vector<double> widths;
  const auto width = static_cast<std::size_t>(grey.width);
  for (int y = 0; y < grey.height; y += kLineStep)
    addEdges(grey.at.data() + static_cast<std::size_t>(y) * width, grey.width, 1, least_slope, widths);
  for (int x = 0; x < grey.width; x += kLineStep)
    addEdges(grey.at.data() + x, grey.height, width, least_slope, widths);
  quality.edges = static_cast<int>(widths.size());
  if (quality.edges < ImageQuality::kFewestEdges) return quality;
  const auto sharpest =
      widths.begin() + static_cast<std::ptrdiff_t>(kSharpest * static_cast<double>(widths.size()));
  std::nth_element(widths.begin(), sharpest, widths.end());
  quality.edge_width_px = *sharpest * (image.format == PixelFormat::kBayerRggb ? 2 : 1);
  return quality;
}

}  // namespace fathom::io

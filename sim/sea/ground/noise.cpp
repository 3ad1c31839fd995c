#include "sim/sea/ground/noise.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::sim {
namespace {

// Standard deviation of gradientNoise over space, measured.
constexpr double kGradientNoiseSigma = 0.25;

constexpr float kVolumeScale = 32.0F;  // lattice values are deviates times this, so four sigma fit a byte
// Trilinear interpolation averages the variance of independent values by (2/3)^3.
const float kVolumeGain = 1.0F / (kVolumeScale * std::sqrt(8.0F / 27.0F));

double fade(double t) {
  return t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
}

// Dot product with one of the twelve edge directions of a cube.
double edgeGradient(std::uint64_t h, double x, double y, double z) {
  h &= 15;
  const double u = h < 8 ? x : y;
  const double v = h < 4 ? y : (h == 12 || h == 14 ? x : z);
  return ((h & 1) ? -u : u) + ((h & 2) ? -v : v);
}

}  // namespace

double gradientNoise(std::uint64_t seed, double x, double y, double z) {
  const double fx = std::floor(x), fy = std::floor(y), fz = std::floor(z);
  x -= fx, y -= fy, z -= fz;
  const auto corner = [&](int i, int j, int k) {
    const auto cell = [](double f, int offset) {
      return static_cast<std::uint64_t>(static_cast<std::int64_t>(f) + offset) & 0x1FFFFF;
    };
    const std::uint64_t h = hash64(seed ^ (cell(fx, i) | cell(fy, j) << 21 | cell(fz, k) << 42));
    return edgeGradient(h >> 60, x - i, y - j, z - k);
  };
  const double u = fade(x), v = fade(y), w = fade(z);
  const auto mix = [](double a, double b, double t) { return a + t * (b - a); };
  return mix(mix(mix(corner(0, 0, 0), corner(1, 0, 0), u), mix(corner(0, 1, 0), corner(1, 1, 0), u), v),
             mix(mix(corner(0, 0, 1), corner(1, 0, 1), u), mix(corner(0, 1, 1), corner(1, 1, 1), u), v), w);
}

double FractalNoise::operator()(double x, double y, double z) const {
  constexpr double kRotate = 0.6;  // [rad] between octaves, hides the lattice
  const double c = std::cos(kRotate), s = std::sin(kRotate);
  double sum = 0.0, variance = 0.0, amplitude = 1.0, frequency = 1.0 / wavelength;
  for (int i = 0; i < octaves; ++i) {
    sum += amplitude * gradientNoise(hash64(seed, static_cast<std::uint64_t>(i)), x * frequency + 0.37,
                                     y * frequency + 0.71, z * frequency + 0.13);
    variance += amplitude * amplitude;
    const double rx = c * x - s * y, ry = s * x + c * y;
    x = rx, y = c * ry - s * z, z = s * ry + c * z;
    amplitude *= gain;
    frequency *= 2.0;
  }
  return sum / (kGradientNoiseSigma * std::sqrt(variance));
}

NoiseVolume::NoiseVolume(std::uint64_t seed) : values_(kSize * kSize * kSize) {
  for (std::size_t i = 0; i < values_.size(); ++i) {
    // Sum of eight uniform bytes: close enough to a normal deviate.
    const std::uint64_t h = hash64(seed, i);
    double sum = 0.0;
    for (int byte = 0; byte < 8; ++byte) sum += static_cast<double>((h >> (8 * byte)) & 0xFF) / 255.0 - 0.5;
    const double deviate = sum / std::sqrt(8.0 / 12.0);
    values_[i] = static_cast<std::int8_t>(std::clamp(std::lround(deviate * kVolumeScale), -127L, 127L));
  }
}

float NoiseVolume::sample(const Eigen::Vector3f& p, Eigen::Vector3f& gradient) const {
  constexpr int kMask = kSize - 1;
  const auto floorInt = [](float v) {
    const int i = static_cast<int>(v);
    return i - (v < static_cast<float>(i));
  };
  const int ix = floorInt(p.x()), iy = floorInt(p.y()), iz = floorInt(p.z());
  const float u = p.x() - static_cast<float>(ix), v = p.y() - static_cast<float>(iy),
              w = p.z() - static_cast<float>(iz);
  const int x0 = ix & kMask, x1 = (ix + 1) & kMask;
  const std::int8_t* row00 =
      &values_[static_cast<std::size_t>(((iz & kMask) * kSize + (iy & kMask)) * kSize)];
  const std::int8_t* row01 =
      &values_[static_cast<std::size_t>(((iz & kMask) * kSize + ((iy + 1) & kMask)) * kSize)];
  const std::int8_t* row10 =
      &values_[static_cast<std::size_t>((((iz + 1) & kMask) * kSize + (iy & kMask)) * kSize)];
  const std::int8_t* row11 =
      &values_[static_cast<std::size_t>((((iz + 1) & kMask) * kSize + ((iy + 1) & kMask)) * kSize)];
  const float a000 = row00[x0], d00 = row00[x1] - a000;
  const float a010 = row01[x0], d01 = row01[x1] - a010;
  const float a100 = row10[x0], d10 = row10[x1] - a100;
  const float a110 = row11[x0], d11 = row11[x1] - a110;
  const float c00 = a000 + u * d00, c01 = a010 + u * d01, c10 = a100 + u * d10, c11 = a110 + u * d11;
  const float c0 = c00 + v * (c01 - c00), c1 = c10 + v * (c11 - c10);
  const float dx0 = d00 + v * (d01 - d00), dx1 = d10 + v * (d11 - d10);
  gradient = kVolumeGain *
             Eigen::Vector3f(dx0 + w * (dx1 - dx0), (c01 - c00) + w * ((c11 - c10) - (c01 - c00)), c1 - c0);
  return kVolumeGain * (c0 + w * (c1 - c0));
}

}  // namespace fathom::sim

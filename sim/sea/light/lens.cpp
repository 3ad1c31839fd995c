#include "sim/sea/light/lens.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "recon/geometry/camera.hpp"

namespace fathom::sim {
namespace {

// Snell's law for unit vectors: light of direction `d` meets a face of unit normal `n` (d . n > 0).
Eigen::Vector3d refracted(const Eigen::Vector3d& d, const Eigen::Vector3d& n, double from, double to) {
  const double ratio = from / to, cosine = d.dot(n);
  return ratio * d + (std::sqrt(1 - ratio * ratio * (1 - cosine * cosine)) - ratio * cosine) * n;
}

struct WaterRay {
  Eigen::Vector3d origin, direction;
};

// From the camera's centre through the glass.
WaterRay throughPort(const FlatPort& port, const Eigen::Vector2d& pixel) {
  const Eigen::Vector3d& n = port.normal;
  const Eigen::Vector2d lens = port.air.undistort(pixel);
  const Eigen::Vector3d in_air = Eigen::Vector3d(lens.x(), lens.y(), 1).normalized();
  const Eigen::Vector3d inner = port.distance / in_air.dot(n) * in_air;
  const Eigen::Vector3d in_glass = refracted(in_air, n, 1, port.glass_index);
  const Eigen::Vector3d outer = inner + port.glass / in_glass.dot(n) * in_glass;
  return {outer, refracted(in_glass, n, port.glass_index, port.water_index)};
}

std::size_t pixelAt(const BlurImage& image, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
}

// Standard deviation of the Gaussian with the second moments of a disc.
float sigmaOf(float across) {
  return 0.25F * across;
}

}  // namespace

CameraRays::CameraRays(const Camera& camera)
    : width_(camera.width),
      height_(camera.height),
      rays_(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height)) {
  if (camera.port) origins_.resize(rays_.size());
  oneapi::tbb::parallel_for(0, height_, [&](int y) {
    for (int x = 0; x < width_; ++x) {
      const std::size_t at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
      if (camera.port) {
        const WaterRay ray = throughPort(*camera.port, {x, y});
        origins_[at] = ray.origin.cast<float>();
        rays_[at] = (ray.direction.head<2>() / ray.direction.z()).cast<float>();
      } else {
        rays_[at] = camera.undistort({x, y}).cast<float>();
      }
    }
  });
}

Eigen::Vector2f CameraRays::near(int x, int y, float dx, float dy) const {
  const int x0 = std::max(0, x - 1), x1 = std::min(width_ - 1, x + 1);
  const int y0 = std::max(0, y - 1), y1 = std::min(height_ - 1, y + 1);
  Eigen::Vector2f ray = at(x, y);
  if (x1 > x0) ray += dx / static_cast<float>(x1 - x0) * (at(x1, y) - at(x0, y));
  if (y1 > y0) ray += dy / static_cast<float>(y1 - y0) * (at(x, y1) - at(x, y0));
  return ray;
}

void blur(const BlurImage& blurred, double sigma_px) {
  std::vector<float>& image = blurred.values;
  const int width = blurred.width, height = blurred.height, channels = blurred.channels;
  if (sigma_px <= 0) return;
  const int radius = std::max(1, static_cast<int>(std::ceil(3 * sigma_px)));
  std::vector<float> weights(static_cast<std::size_t>(radius) + 1);
  float total = 0;
  for (int i = 0; i <= radius; ++i) {
    weights[static_cast<std::size_t>(i)] = static_cast<float>(std::exp(-0.5 * i * i / (sigma_px * sigma_px)));
    total += (i == 0 ? 1.0F : 2.0F) * weights[static_cast<std::size_t>(i)];
  }
  for (float& w : weights) w /= total;
  const auto row_size = static_cast<std::size_t>(width) * static_cast<std::size_t>(channels);
  std::vector<float> across(image.size());
  // Rows: the stride of neighbours is `channels`. Only the ends need clamping.
  oneapi::tbb::parallel_for(0, height, [&](int y) {
    const float* in = &image[static_cast<std::size_t>(y) * row_size];
    float* out = &across[static_cast<std::size_t>(y) * row_size];
    for (std::size_t i = 0; i < row_size; ++i) out[i] = weights[0] * in[i];
    for (int k = 1; k <= radius; ++k) {
      const float w = weights[static_cast<std::size_t>(k)];
      const auto add = [&](int x) {
        for (int c = 0; c < channels; ++c)
          out[x * channels + c] +=
              w * (in[std::max(0, x - k) * channels + c] + in[std::min(width - 1, x + k) * channels + c]);
      };
      const int inner_end = std::max(k, width - k);
      for (int x = 0; x < std::min(k, width); ++x) add(x);
      for (int i = k * channels; i < (width - k) * channels; ++i)
        out[i] += w * (in[i - k * channels] + in[i + k * channels]);
      for (int x = inner_end; x < width; ++x) add(x);
    }
  });
  oneapi::tbb::parallel_for(0, height, [&](int y) {
    float* out = &image[static_cast<std::size_t>(y) * row_size];
    const auto row = [&](int at) {
      return &across[static_cast<std::size_t>(std::clamp(at, 0, height - 1)) * row_size];
    };
    const float* centre = row(y);
    for (std::size_t i = 0; i < row_size; ++i) out[i] = weights[0] * centre[i];
    for (int k = 1; k <= radius; ++k) {
      const float w = weights[static_cast<std::size_t>(k)];
      const float *above = row(y - k), *below = row(y + k);
      for (std::size_t i = 0; i < row_size; ++i) out[i] += w * (above[i] + below[i]);
    }
  });
}

void motionBlur(const BlurImage& image, const std::function<Eigen::Vector2f(int x, int y)>& shift) {
  const std::vector<float> sharp = image.values;
  const auto channels = static_cast<std::size_t>(image.channels);
  oneapi::tbb::parallel_for(0, image.height, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      const Eigen::Vector2f along = shift(x, y);
      const int steps = static_cast<int>(std::ceil(2 * along.norm()));
      if (steps == 0) continue;
      std::array<float, 3> sum{};
      for (int k = 0; k < steps; ++k) {
        const Eigen::Vector2f p = Eigen::Vector2f(static_cast<float>(x), static_cast<float>(y)) +
                                  ((static_cast<float>(k) + 0.5F) / static_cast<float>(steps) - 0.5F) * along;
        const float px = std::clamp(p.x(), 0.0F, static_cast<float>(image.width - 1)),
                    py = std::clamp(p.y(), 0.0F, static_cast<float>(image.height - 1));
        const int x0 = std::min(static_cast<int>(px), image.width - 2),
                  y0 = std::min(static_cast<int>(py), image.height - 2);
        const float u = px - static_cast<float>(x0), v = py - static_cast<float>(y0);
        const float* top = &sharp[channels * pixelAt(image, x0, y0)];
        const float* bottom = &sharp[channels * pixelAt(image, x0, y0 + 1)];
        for (std::size_t c = 0; c < channels; ++c)
          sum[c] += (1 - v) * ((1 - u) * top[c] + u * top[c + channels]) +
                    v * ((1 - u) * bottom[c] + u * bottom[c + channels]);
      }
      for (std::size_t c = 0; c < channels; ++c)
        image.values[channels * pixelAt(image, x, y) + c] = sum[c] / static_cast<float>(steps);
    }
  });
}

float discAcross(float inverse_range, double aperture_px_m, double focus_m) {
  return static_cast<float>(aperture_px_m * std::abs(static_cast<double>(inverse_range) - 1 / focus_m));
}

void defocus(const BlurImage& image, const std::vector<float>& inverse_range, double aperture_px_m,
             double focus_m) {
  if (aperture_px_m <= 0) return;
  // Blurred copies; each pixel interpolates between the two next to its own blur.
  constexpr std::array<float, 6> kSigmas = {0, 0.5F, 1, 2, 4, 8};
  std::vector<std::vector<float>> levels(kSigmas.size(), image.values);
  for (std::size_t k = 1; k < kSigmas.size(); ++k)
    blur({levels[k], image.width, image.height, image.channels}, static_cast<double>(kSigmas[k]));
  const auto channels = static_cast<std::size_t>(image.channels);
  for (std::size_t pixel = 0; pixel < inverse_range.size(); ++pixel) {
    const float sigma =
        std::min(sigmaOf(discAcross(inverse_range[pixel], aperture_px_m, focus_m)), kSigmas.back());
    std::size_t k = 0;
    while (k + 2 < kSigmas.size() && kSigmas[k + 1] < sigma) ++k;
    // A mixture's variance is linear in the weights: this one has the pixel's variance.
    const float a = kSigmas[k] * kSigmas[k], b = kSigmas[k + 1] * kSigmas[k + 1];
    const float share = std::clamp((sigma * sigma - a) / (b - a), 0.0F, 1.0F);
    for (std::size_t c = pixel * channels; c < (pixel + 1) * channels; ++c)
      image.values[c] = (1 - share) * levels[k][c] + share * levels[k + 1][c];
  }
}

void forwardScatter(const BlurImage& image, const std::vector<float>& inverse_range, double per_metre,
                    double spread_px) {
  if (per_metre <= 0) return;
  const auto channels = static_cast<std::size_t>(image.channels);
  std::vector<float> spread = image.values;
  for (std::size_t pixel = 0; pixel < inverse_range.size(); ++pixel) {
    const double range = inverse_range[pixel] > 0 ? 1 / static_cast<double>(inverse_range[pixel]) : 0;
    const auto stays = static_cast<float>(std::exp(-per_metre * range));
    for (std::size_t c = pixel * channels; c < (pixel + 1) * channels; ++c) {
      spread[c] *= 1 - stays;
      image.values[c] *= stays;
    }
  }
  blur({spread, image.width, image.height, image.channels}, spread_px);
  for (std::size_t k = 0; k < spread.size(); ++k) image.values[k] += spread[k];
}

std::vector<LampInView> lampsInView(const OpticsConfig& lamps, const SE3& T_body_cam) {
  std::vector<LampInView> out;
  for (const StrobeConfig& strobe : lamps.strobes) {
    const Eigen::Vector3d to = T_body_cam.inverse() * strobe.position_body;
    out.push_back(
        {to.normalized(), lamps.sensor.glare * strobe.intensity / to.squaredNorm() / std::numbers::pi});
  }
  return out;
}

float glareAt(const std::vector<LampInView>& lamps, const Eigen::Vector2f& ray) {
  constexpr double kWide = 0.3;  // angle off the lamp at which it has fallen to a quarter [rad]
  const Eigen::Vector3d direction = ray.homogeneous().cast<double>().normalized();
  double sum = 0;
  for (const LampInView& lamp : lamps) {
    const double angle = std::acos(std::clamp(direction.dot(lamp.direction), -1.0, 1.0));
    const double fall = kWide / (kWide + angle);
    sum += lamp.strength * fall * fall;
  }
  return static_cast<float>(sum);
}

}  // namespace fathom::sim

#include "tests/bench/lighting/brightness_steps.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

namespace fathom::bench {
namespace {

constexpr double kPatch = 0.10;         // half the width of a patch [m]
constexpr int kAcross = 12, kDown = 9;  // patches tried in an image
constexpr std::size_t kOtherPass = 20;  // images apart: another line
constexpr double kNear = 0.5;           // of a footprint: lines that overlap

int colourAt(int x, int y, PixelFormat format) {
  if (format == PixelFormat::kMono) return 0;
  return y % 2 == 0 ? (x % 2 == 0 ? 0 : 1) : (x % 2 == 0 ? 1 : 2);
}

double rawSample(const ImageView& raw, int x, int y) {
  const auto* row = static_cast<const std::uint8_t*>(raw.data) + static_cast<std::size_t>(y) * raw.stride;
  return (raw.bits == 8 ? row[x] : reinterpret_cast<const std::uint16_t*>(row)[x]) /
         static_cast<double>((1 << raw.bits) - 1);
}

}  // namespace

BrightnessSteps::BrightnessSteps(const TrueMission& mission, std::size_t images) : mission_(mission) {
  const auto& pairs = mission.pairs();
  const Camera& camera = mission.rig().left;
  const std::size_t step = std::max<std::size_t>(1, pairs.size() / images);
  const auto apart = [&](std::size_t a, std::size_t b) {
    return (pairs[a].T_nav_cam.translation() - pairs[b].T_nav_cam.translation()).head<2>().norm();
  };
  for (std::size_t a = 0; a < pairs.size(); a += step) {
    // The footprint's shorter side lies along the track.
    const double footprint =
        pairs[a].plane.distance * std::min(camera.width / camera.fx, camera.height / camera.fy);
    if (a + 1 < pairs.size()) findPatches(a, a + 1, kNext);
    std::size_t half = a + 1;
    while (half < pairs.size() && half < a + kOtherPass && apart(a, half) < 0.5 * footprint) ++half;
    if (half < pairs.size() && half < a + kOtherPass) findPatches(a, half, kHalfFootprint);
    std::size_t other = a;
    for (std::size_t b = 0; b < pairs.size(); ++b)
      if (b > a + kOtherPass && (other == a || apart(a, b) < apart(a, other))) other = b;
    if (other != a && apart(a, other) < kNear * footprint) findPatches(a, other, kOtherLine);
  }
}

void BrightnessSteps::findPatches(std::size_t a, std::size_t b, Neighbour neighbour) {
  const Camera& camera = mission_.rig().left;
  for (int j = 0; j < kDown; ++j)
    for (int i = 0; i < kAcross; ++i) {
      const Eigen::Vector2d pixel((i + 0.5) * camera.width / kAcross, (j + 0.5) * camera.height / kDown);
      const auto point = mission_.pointAt(a, pixel);
      if (!point) continue;
      const auto there = mission_.pixelOf(b, a, *point);
      if (!there) continue;
      const Eigen::Vector3d in_nav = mission_.pairs()[a].T_nav_cam * *point;
      const auto half = [&](std::size_t image) {
        const double range = (in_nav - mission_.pairs()[image].T_nav_cam.translation()).norm();
        return std::max(2, static_cast<int>(std::lround(kPatch * camera.fx / range)));
      };
      const int half_a = half(a), half_b = half(b);
      if (!camera.contains(pixel, half_a + 1) || !camera.contains(*there, half_b + 1)) continue;
      patches_.push_back({a, pixel, half_a});
      patches_.push_back({b, *there, half_b});
      matches_.push_back({patches_.size() - 2, patches_.size() - 1, neighbour});
    }
}

std::vector<std::size_t> BrightnessSteps::images() const {
  std::set<std::size_t> images;
  for (const Patch& patch : patches_) images.insert(patch.image);
  return {images.begin(), images.end()};
}

void BrightnessSteps::measure(std::size_t image, const ImageView& raw, const CorrectedPair& pair) {
  const Camera& camera = mission_.rig().left;
  const PixelFormat format = mission_.config().cameras.left_format;
  for (Patch& patch : patches_) {
    if (patch.image != image) continue;
    const int x0 = static_cast<int>(std::lround(patch.centre.x())),
              y0 = static_cast<int>(std::lround(patch.centre.y()));
    for (int k = 0; k < Corrections::kCount; ++k) {
      double n[3] = {}, sum[3] = {}, squares[3] = {};
      for (int y = y0 - patch.half; y <= y0 + patch.half; ++y)
        for (int x = x0 - patch.half; x <= x0 + patch.half; ++x) {
          const int c = colourAt(x, y, format);
          const auto at = static_cast<std::size_t>(y * camera.width + x);
          const double v = k == Corrections::kRaw ? rawSample(raw, x, y)
                                                  : pair.left[static_cast<std::size_t>(k)][at] / 255.0;
          n[c] += 1, sum[c] += v, squares[c] += v * v;
        }
      for (std::size_t c = 0; c < 3; ++c) {
        const double mean = n[c] > 0 ? sum[c] / n[c] : -1;
        patch.mean[static_cast<std::size_t>(k)][c] = static_cast<float>(mean);
        patch.deviation[static_cast<std::size_t>(k)][c] =
            static_cast<float>(n[c] > 0 ? std::sqrt(std::max(0.0, squares[c] / n[c] - mean * mean)) : 0);
      }
    }
  }
}

BrightnessStep BrightnessSteps::result(int correction, Neighbour neighbour) const {
  const auto k = static_cast<std::size_t>(correction);
  struct Sums {
    double n = 0, step = 0, texture = 0;
  };
  std::map<std::pair<std::size_t, std::size_t>, Sums> of_images;
  double mean = 0, count = 0;
  for (const Match& match : matches_) {
    if (match.neighbour != neighbour) continue;
    const Patch &a = patches_[match.a], &b = patches_[match.b];
    Sums& sums = of_images[{a.image, b.image}];
    for (std::size_t c = 0; c < 3; ++c) {
      // What the camera saturated, no correction brings back.
      constexpr float kSaturated = 0.9F;
      if (std::max(a.mean[Corrections::kRaw][c], b.mean[Corrections::kRaw][c]) > kSaturated) continue;
      sums.n += 1;
      sums.step += std::pow(static_cast<double>(a.mean[k][c] - b.mean[k][c]), 2);
      sums.texture += 0.5 * (std::pow(static_cast<double>(a.deviation[k][c]), 2) +
                             std::pow(static_cast<double>(b.deviation[k][c]), 2));
      count += 1;
      mean += 0.5 * static_cast<double>(a.mean[k][c] + b.mean[k][c]);
    }
  }
  BrightnessStep out;
  double images = 0;
  for (const auto& [pair, sums] : of_images) {
    constexpr double kEnough = 30;  // patches and colours
    if (sums.n < kEnough || sums.texture <= 0) continue;
    images += 1;
    out.step += std::sqrt(sums.step / sums.n) / (mean / count);
    out.jump += std::sqrt(sums.step / sums.texture);
    out.patches += static_cast<std::size_t>(sums.n) / 3;
  }
  if (images > 0) out.step /= images, out.jump /= images;
  return out;
}

}  // namespace fathom::bench

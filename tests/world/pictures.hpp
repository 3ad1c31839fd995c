#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "recon/closure/feature_extractor.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "tests/world/rigs.hpp"

namespace fathom::test {

// A periodic lattice of normal random numbers, smooth in between: cubic B-splines.
class SplineNoise {
 public:
  static constexpr int kOctaves = 5;      // sizes that make a texture
  static constexpr double kSigma = 0.48;  // of its values

  explicit SplineNoise(std::uint32_t seed) : lattice_(kSide * kSide) {
    std::mt19937 random(seed);
    std::normal_distribution<float> normal;
    for (float& v : lattice_) v = normal(random);
  }
  [[nodiscard]] double operator()(double u, double v) const {
    const double fu = std::floor(u), fv = std::floor(v);
    const auto wu = weights(u - fu), wv = weights(v - fv);
    double value = 0;
    for (int j = 0; j < 4; ++j)
      for (int i = 0; i < 4; ++i) {
        const int x = (static_cast<int>(fu) + i) & (kSide - 1), y = (static_cast<int>(fv) + j) & (kSide - 1);
        value += wv[static_cast<std::size_t>(j)] * wu[static_cast<std::size_t>(i)] *
                 static_cast<double>(lattice_[static_cast<std::size_t>(y * kSide + x)]);
      }
    return value;
  }

 private:
  static constexpr int kSide = 256;
  static std::array<double, 4> weights(double t) {
    const double s = 1 - t;
    return {s * s * s / 6, (3 * t * t * t - 6 * t * t + 4) / 6, (3 * s * s * s - 6 * s * s + 4) / 6,
            t * t * t / 6};
  }
  std::vector<float> lattice_;
};

// Of textures, as the lighting model leaves images [grey levels].
inline constexpr double kMeanGrey = 107, kSigmaGrey = 33;

// A sheet of textured surface, z = height(x, y) in the left camera frame [m], where present(x, y).
struct Sheet {
  std::function<double(double, double)> height;
  std::function<bool(double, double)> present = [](double, double) { return true; };
};

// What a camera makes of the light: value = gain * texture + offset + noise, in 8 bits.
struct Exposure {
  double gain = 1.0;
  double offset = 0.0;  // [grey levels]
  double noise = 2.0;   // standard deviation [grey levels]
};

struct GrayImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;
  [[nodiscard]] ImageView view() const {
    return {pixels.data(), width, height, static_cast<std::size_t>(width), PixelFormat::kMono, 8};
  }
};

// Sheets under a stereo rig, painted with band-limited random texture: the sum of cubic B-spline noise of
// several sizes from `finest` [m] upwards. Images are made by following each pixel's ray, through the lens,
// to the nearest sheet.
class SyntheticScene {
 public:
  SyntheticScene(StereoRig rig, std::vector<Sheet> sheets, double finest = 0.003, std::uint32_t seed = 1)
      : rig_(std::move(rig)), sheets_(std::move(sheets)), finest_(finest), noise_(seed) {}

  [[nodiscard]] std::pair<GrayImage, GrayImage> render(const Exposure& left, const Exposure& right) const {
    return {shoot(rig_.left, SE3(), left, 11), shoot(rig_.right, rig_.T_right_left.inverse(), right, 12)};
  }
  // Point seen by a left pixel, in the left camera frame; false where there is none.
  [[nodiscard]] bool pointAt(const Eigen::Vector2d& left_pixel, Eigen::Vector3d& point,
                             int* sheet = nullptr) const {
    int which = 0;
    if (!intersect(Eigen::Vector3d::Zero(), rig_.left.ray(left_pixel), point, which)) return false;
    if (sheet != nullptr) *sheet = which;
    return true;
  }
  // Right pixel of the same point.
  [[nodiscard]] Eigen::Vector2d rightPixel(const Eigen::Vector3d& point) const {
    return rig_.right.project(rig_.T_right_left * point);
  }
  [[nodiscard]] const StereoRig& rig() const { return rig_; }

 private:
  [[nodiscard]] bool intersect(const Eigen::Vector3d& origin, const Eigen::Vector3d& ray,
                               Eigen::Vector3d& point, int& sheet) const {
    double nearest = std::numeric_limits<double>::max();
    for (std::size_t k = 0; k < sheets_.size(); ++k) {
      double t = (sheets_[k].height(0, 0) - origin.z()) / ray.z();
      Eigen::Vector3d p = origin;
      for (int i = 0; i < 60; ++i) {
        p = origin + t * ray;
        const double next = (sheets_[k].height(p.x(), p.y()) - origin.z()) / ray.z();
        const double change = std::abs(next - t);
        t = next;
        if (change < 1e-9) break;
      }
      if (t <= 0 || t >= nearest || !sheets_[k].present(p.x(), p.y())) continue;
      nearest = t;
      point = origin + t * ray;
      sheet = static_cast<int>(k);
    }
    return nearest < std::numeric_limits<double>::max();
  }
  [[nodiscard]] double texture(double x, double y, int sheet) const {
    double sum = 0, size = finest_, power = 0;
    for (int octave = 0; octave < SplineNoise::kOctaves; ++octave, size *= 2) {
      // Each sheet and size begins elsewhere in the lattice.
      const double u = x / size + 61.7 * sheet + 17.3 * octave, v = y / size + 23.9 * sheet + 41.1 * octave;
      sum += noise_(u, v);
      power += SplineNoise::kSigma * SplineNoise::kSigma;
    }
    return kMeanGrey + kSigmaGrey * sum / std::sqrt(power);
  }
  [[nodiscard]] GrayImage shoot(const Camera& camera, const SE3& T_left_camera, const Exposure& exposure,
                                std::uint32_t seed) const {
    GrayImage image{camera.width, camera.height, {}};
    image.pixels.resize(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    const Eigen::Matrix3d rotation = T_left_camera.matrix3();
    std::size_t k = 0;
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x, ++k) {
        Eigen::Vector3d point;
        int sheet = 0;
        double value = 0;
        if (intersect(T_left_camera.translation(), rotation * camera.ray({x, y}), point, sheet))
          value = texture(point.x(), point.y(), sheet);
        value = exposure.gain * value + exposure.offset + exposure.noise * normal(random);
        image.pixels[k] = static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0)));
      }
    }
    return image;
  }

  StereoRig rig_;
  std::vector<Sheet> sheets_;
  double finest_;
  SplineNoise noise_;
};

// Synthetic seafloor: depth and brightness over north and east.
struct Seafloor {
  std::function<double(double, double)> depth;    // nav z [m]
  std::function<double(double, double)> texture;  // standard deviation about 1
};

inline GrayImage shootOne(const Seafloor& seafloor, const Camera& camera, const SE3& T_nav_cam, double gain,
                          std::uint32_t seed) {
  constexpr double kNoise = 2;  // [grey levels]
  constexpr int kSteps = 40;
  GrayImage image{camera.width, camera.height, {}};
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const Eigen::Vector3d& from = T_nav_cam.translation();
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Eigen::Vector3d ray = T_nav_cam.rotation() * camera.ray({x, y});
      double t = (seafloor.depth(from.x(), from.y()) - from.z()) / ray.z();
      for (int k = 0; k < kSteps; ++k) {
        const double next =
            (seafloor.depth(from.x() + t * ray.x(), from.y() + t * ray.y()) - from.z()) / ray.z();
        if (std::abs(next - t) < 1e-7) break;
        t = next;
      }
      const double value =
          kMeanGrey + kSigmaGrey * seafloor.texture(from.x() + t * ray.x(), from.y() + t * ray.y());
      image.pixels.push_back(static_cast<std::uint8_t>(
          std::lround(std::clamp(gain * value + kNoise * normal(random), 0.0, 255.0))));
    }
  return image;
}

// Band-limited random texture: cubic B-spline noise of five sizes from `finest` [m] upwards, without period
// within hundreds of metres.
[[nodiscard]] inline std::function<double(double, double)> randomTexture(double finest, std::uint32_t seed) {
  const auto noise = std::make_shared<SplineNoise>(seed);
  return [noise, finest](double north, double east) {
    constexpr double kTurn = 0.7;  // between sizes, so that their periods never meet [rad]
    double sum = 0, size = finest;
    for (int octave = 0; octave < SplineNoise::kOctaves; ++octave, size *= 2) {
      const double c = std::cos(kTurn * octave), s = std::sin(kTurn * octave);
      sum += (*noise)((c * north - s * east) / size + 17.3 * octave,
                      (s * north + c * east) / size + 41.1 * octave);
    }
    return sum / (SplineNoise::kSigma * std::sqrt(static_cast<double>(SplineNoise::kOctaves)));
  };
}

// Both images, with noise of 2 grey levels that differs with `seed`; the right one at 0.85 of the brightness.
[[nodiscard]] inline std::pair<GrayImage, GrayImage> shoot(const Seafloor& seafloor, const StereoRig& rig,
                                                           const SE3& T_nav_cam, std::uint32_t seed) {
  constexpr double kRightGain = 0.85;
  return {shootOne(seafloor, rig.left, T_nav_cam, 1.0, 2 * seed),
          shootOne(seafloor, rig.right, T_nav_cam * rig.T_right_left.inverse(), kRightGain, 2 * seed + 1)};
}

// Up to 400 features of smallRig()'s images, as shoot() takes them.
[[nodiscard]] inline closure::FrameFeatures featuresOf(const Seafloor& seafloor, const SE3& T_nav_cam,
                                                       std::uint32_t seed) {
  closure::FeatureConfig config;
  config.max_features = 400;
  closure::FeatureExtractor extractor(smallRig(), config);
  const auto images = shoot(seafloor, smallRig(), T_nav_cam, seed);
  return extractor.process(images.first.view(), images.second.view());
}

// A camera over a place, looking down, turned by yaw; roll and pitch in rad.
[[nodiscard]] inline SE3 lookingDown(double north, double east, double depth, double yaw, double roll = 0,
                                     double pitch = 0) {
  return SE3::fromEuler(roll, pitch, yaw, {north, east, depth});
}

}  // namespace fathom::test

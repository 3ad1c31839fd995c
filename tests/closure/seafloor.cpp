#include "tests/closure/seafloor.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <random>

namespace fathom::test {
namespace {

constexpr int kSide = 256;  // of the lattice of random numbers
constexpr int kOctaves = 5;

std::array<double, 4> splineWeights(double t) {
  const double s = 1 - t;
  return {s * s * s / 6, (3 * t * t * t - 6 * t * t + 4) / 6, (3 * s * s * s - 6 * s * s + 4) / 6,
          t * t * t / 6};
}

double splineNoise(const std::vector<float>& lattice, double u, double v) {
  const double fu = std::floor(u), fv = std::floor(v);
  const auto wu = splineWeights(u - fu), wv = splineWeights(v - fv);
  double value = 0;
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i) {
      const int x = (static_cast<int>(fu) + i) & (kSide - 1), y = (static_cast<int>(fv) + j) & (kSide - 1);
      value += wv[static_cast<std::size_t>(j)] * wu[static_cast<std::size_t>(i)] *
               static_cast<double>(lattice[static_cast<std::size_t>(y * kSide + x)]);
    }
  return value;
}

std::vector<std::uint8_t> shootOne(const Seafloor& seafloor, const Camera& camera, const SE3& T_nav_cam,
                                   double gain, std::uint32_t seed) {
  constexpr double kMean = 107, kSigma = 33, kNoise = 2;  // [grey levels]
  constexpr int kSteps = 40;
  std::vector<std::uint8_t> pixels;
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
      const double value = kMean + kSigma * seafloor.texture(from.x() + t * ray.x(), from.y() + t * ray.y());
      pixels.push_back(static_cast<std::uint8_t>(
          std::lround(std::clamp(gain * value + kNoise * normal(random), 0.0, 255.0))));
    }
  return pixels;
}

}  // namespace

std::function<double(double, double)> randomTexture(double finest, std::uint32_t seed) {
  auto lattice = std::make_shared<std::vector<float>>(kSide * kSide);
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  for (float& v : *lattice) v = normal(random);
  return [lattice, finest](double north, double east) {
    constexpr double kSplineSigma = 0.48;  // of the spline's value for lattice values of sigma 1
    constexpr double kTurn = 0.7;          // between sizes, so that their periods never meet [rad]
    double sum = 0, size = finest;
    for (int octave = 0; octave < kOctaves; ++octave, size *= 2) {
      const double c = std::cos(kTurn * octave), s = std::sin(kTurn * octave);
      sum += splineNoise(*lattice, (c * north - s * east) / size + 17.3 * octave,
                         (s * north + c * east) / size + 41.1 * octave);
    }
    return sum / (kSplineSigma * std::sqrt(static_cast<double>(kOctaves)));
  };
}

StereoImages shoot(const Seafloor& seafloor, const StereoRig& rig, const SE3& T_nav_cam, std::uint32_t seed) {
  constexpr double kRightGain = 0.85;
  return {rig.left.width, rig.left.height, shootOne(seafloor, rig.left, T_nav_cam, 1.0, 2 * seed),
          shootOne(seafloor, rig.right, T_nav_cam * rig.T_right_left.inverse(), kRightGain, 2 * seed + 1)};
}

closure::FrameFeatures featuresOf(const Seafloor& seafloor, const SE3& T_nav_cam, std::uint32_t seed) {
  closure::FeatureConfig config;
  config.max_features = 400;
  closure::FeatureExtractor extractor(smallRig(), config);
  const auto images = shoot(seafloor, smallRig(), T_nav_cam, seed);
  return extractor.process(images.leftView(), images.rightView());
}

SE3 lookingDown(double north, double east, double depth, double yaw, double roll, double pitch) {
  return SE3::fromEuler(roll, pitch, yaw, {north, east, depth});
}

StereoRig smallRig() {
  StereoRig rig;
  rig.left = {480, 384, 607.0, 606.0, 243.1, 188.4, 0.136, 0.655, 0.0021, -0.0013, 0};
  rig.right = {480, 384, 608.2, 607.1, 238.2, 194.0, 0.142, 0.69, -0.0012, 0.0017, 0};
  rig.T_right_left = SE3::fromEuler(0.0014, -0.0041, 0.0008, {-0.0702, 0.0003, -0.0009});
  return rig;
}

}  // namespace fathom::test

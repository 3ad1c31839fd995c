#include "tests/stereo/synthetic_scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace fathom::test {
namespace {

constexpr int kSide = 256;  // of the periodic lattice of random numbers
constexpr int kOctaves = 5;
constexpr double kMean = 107.0;  // of the texture [grey levels], the lighting model's target
constexpr double kSigma = 33.0;  // likewise

void splineWeights(double t, double (&w)[4]) {
  const double s = 1 - t;
  w[0] = s * s * s / 6;
  w[1] = (3 * t * t * t - 6 * t * t + 4) / 6;
  w[2] = (3 * s * s * s - 6 * s * s + 4) / 6;
  w[3] = t * t * t / 6;
}

}  // namespace

SyntheticScene::SyntheticScene(StereoRig rig, std::vector<Sheet> sheets, double finest, std::uint32_t seed)
    : rig_(std::move(rig)), sheets_(std::move(sheets)), finest_(finest), lattice_(kSide * kSide) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  for (float& v : lattice_) v = normal(random);
}

double SyntheticScene::texture(double x, double y, int sheet) const {
  constexpr double kSplineSigma = 0.48;  // of the spline's value for lattice values of sigma 1
  double sum = 0, size = finest_, power = 0;
  for (int octave = 0; octave < kOctaves; ++octave, size *= 2) {
    // Each sheet and size begins elsewhere in the lattice.
    const double u = x / size + 61.7 * sheet + 17.3 * octave, v = y / size + 23.9 * sheet + 41.1 * octave;
    const double fu = std::floor(u), fv = std::floor(v);
    double wu[4], wv[4];
    splineWeights(u - fu, wu);
    splineWeights(v - fv, wv);
    double value = 0;
    for (int j = 0; j < 4; ++j) {
      const int row = (static_cast<int>(fv) + j) & (kSide - 1);
      for (int i = 0; i < 4; ++i)
        value +=
            wv[j] * wu[i] *
            static_cast<double>(
                lattice_[static_cast<std::size_t>(row * kSide + ((static_cast<int>(fu) + i) & (kSide - 1)))]);
    }
    sum += value;
    power += kSplineSigma * kSplineSigma;
  }
  return kMean + kSigma * sum / std::sqrt(power);
}

bool SyntheticScene::intersect(const Eigen::Vector3d& origin, const Eigen::Vector3d& ray,
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

bool SyntheticScene::pointAt(const Eigen::Vector2d& left_pixel, Eigen::Vector3d& point, int* sheet) const {
  int which = 0;
  if (!intersect(Eigen::Vector3d::Zero(), rig_.left.ray(left_pixel), point, which)) return false;
  if (sheet != nullptr) *sheet = which;
  return true;
}

Eigen::Vector2d SyntheticScene::rightPixel(const Eigen::Vector3d& point) const {
  return rig_.right.project(rig_.T_right_left * point);
}

GrayImage SyntheticScene::shoot(const Camera& camera, const SE3& T_left_camera, const Exposure& exposure,
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

std::pair<GrayImage, GrayImage> SyntheticScene::render(const Exposure& left, const Exposure& right) const {
  return {shoot(rig_.left, SE3(), left, 11), shoot(rig_.right, rig_.T_right_left.inverse(), right, 12)};
}

StereoRig croppedRig(int width, int height) {
  StereoRig rig;
  rig.left = {1360, 1024, 1711.824, 1708.534, 690.864, 499.172, 0.135773, 0.734495, 0.005066, 0.002235, 0};
  rig.right = {1360, 1024, 1712.224, 1710.196, 691.190, 506.179, 0.149481, 0.672554, 0.002992, 0.001838, 0};
  Eigen::Matrix3d rotation;
  rotation << 0.999992, 0.000264, 0.003933, -0.000269, 0.999999, 0.001188, -0.003933, -0.001189, 0.999992;
  rig.T_right_left = SE3(rotation, Eigen::Vector3d(-0.069491, -0.000136, -0.000713));
  for (Camera* camera : {&rig.left, &rig.right}) {
    camera->cx -= (camera->width - width) / 2;
    camera->cy -= (camera->height - height) / 2;
    camera->width = width;
    camera->height = height;
  }
  return rig;
}

}  // namespace fathom::test

#pragma once

#include <random>
#include <string>
#include <vector>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::test {

// A rig like the one of a Sirius-class vehicle, at half size.
inline StereoRig syntheticRig() {
  return StereoRig{.left = {680, 512, 862.7, 861.5, 343.1, 253.7, 0.142, 0.655, 0.0021, -0.0013, 0},
                   .right = {680, 512, 864.4, 863.4, 336.8, 257.4, 0.138, 0.690, -0.0012, 0.0017, 0},
                   .T_right_left = SE3::fromEuler(0.0014, -0.0041, 0.0008, {-0.0702, 0.0003, -0.0009})};
}

// A small rig with the lenses of a real one: 480 x 384 px, 7 cm baseline.
[[nodiscard]] inline StereoRig smallRig() {
  return StereoRig{.left = {480, 384, 607.0, 606.0, 243.1, 188.4, 0.136, 0.655, 0.0021, -0.0013, 0},
                   .right = {480, 384, 608.2, 607.1, 238.2, 194.0, 0.142, 0.69, -0.0012, 0.0017, 0},
                   .T_right_left = SE3::fromEuler(0.0014, -0.0041, 0.0008, {-0.0702, 0.0003, -0.0009})};
}

// The middle of a real rig's images (ACFR, 1360x1024, 7 cm baseline, strong distortion): same lenses,
// smaller chip.
[[nodiscard]] inline StereoRig croppedRig(int width, int height) {
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

inline const calibration::Chessboard kBoard{9, 6, 0.08};

// Corners of a board at poses spread over both images, with Gaussian noise [px].
inline std::vector<calibration::BoardView> syntheticViews(const StereoRig& rig,
                                                          const calibration::Chessboard& board,
                                                          std::size_t count, double noise_px, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, noise_px);
  std::uniform_real_distribution<double> evenly(-1.0, 1.0);
  const std::vector<Eigen::Vector3d> points = calibration::boardPoints(board);
  const Eigen::Vector3d middle = 0.5 * (points.front() + points.back());
  constexpr double kTilt = 0.6;  // [rad]
  std::vector<calibration::BoardView> views;
  while (views.size() < count) {
    const double z = 2.0 + 0.5 * evenly(random);
    const SE3 turn = SE3::fromEuler(kTilt * evenly(random), kTilt * evenly(random), kTilt * evenly(random),
                                    {0.35 * evenly(random), 0.25 * evenly(random), z});
    calibration::BoardView view;
    view.name = "view" + std::to_string(views.size() + 1);
    bool inside = true;
    for (const Eigen::Vector3d& p : points) {
      const Eigen::Vector3d in_left = turn * (p - middle), in_right = rig.T_right_left * in_left;
      view.left.push_back(rig.left.project(in_left) + Eigen::Vector2d(noise(random), noise(random)));
      view.right.push_back(rig.right.project(in_right) + Eigen::Vector2d(noise(random), noise(random)));
      inside = inside && rig.left.contains(view.left.back()) && rig.right.contains(view.right.back());
    }
    if (inside) views.push_back(std::move(view));
  }
  return views;
}

}  // namespace fathom::test

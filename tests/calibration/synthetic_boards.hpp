#pragma once

#include <random>
#include <string>
#include <vector>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::test {

inline const calibration::Chessboard kBoard{9, 6, 0.08};

// A rig like the one of a Sirius-class vehicle, at half size.
inline StereoRig syntheticRig() {
  StereoRig rig;
  rig.left = {680, 512, 862.7, 861.5, 343.1, 253.7, 0.142, 0.655, 0.0021, -0.0013, 0};
  rig.right = {680, 512, 864.4, 863.4, 336.8, 257.4, 0.138, 0.690, -0.0012, 0.0017, 0};
  rig.T_right_left = SE3::fromEuler(0.0014, -0.0041, 0.0008, {-0.0702, 0.0003, -0.0009});
  return rig;
}

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

#pragma once

#include <Eigen/Core>
#include <vector>

#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// The same point of the scene in both images, found without the help of the calibration [px].
struct RigMatch {
  Eigen::Vector2d left, right;
};

inline constexpr int kEpipolarColumns = 8, kEpipolarRows = 6;

struct EpipolarCheck {
  std::vector<double> errors;  // of each match, signed [px]
  double median = 0;           // [px]
  double sigma = 0;            // of one match, from the median absolute deviation [px]
  struct Cell {
    double median = 0;  // of the matches in this part of the left image [px]; 0 when empty
    std::size_t matches = 0;
  };
  std::vector<Cell> cells;  // kEpipolarRows x kEpipolarColumns, row after row
  double worst_cell = 0;    // largest |median| of a cell with enough matches [px]
  int worst_column = 0, worst_row = 0;
  // Rotation of the right camera, about its own x, y and z, that explains the errors best: how it stands now
  // against how it was calibrated. About y (towards the left camera) it hardly moves epipolar lines: see
  // rotation_sigma.
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();        // [rad]
  Eigen::Vector3d rotation_sigma = Eigen::Vector3d::Zero();  // [rad]
  double sigma_after = 0;  // of one match when that rotation is taken out [px]
};

// Fewer matches in a cell say nothing about it.
inline constexpr std::size_t kEnoughInCell = 30;

// Signed distance of the match in the right image from the epipolar line of its left point [px]; positive
// where it lies on the side of growing v.
[[nodiscard]] double epipolarError(const StereoRig& rig, const RigMatch& match);

// Robust throughout: wrong matches may be a third of all. No matches give zeros.
[[nodiscard]] EpipolarCheck checkEpipolar(const StereoRig& rig, const std::vector<RigMatch>& matches);

}  // namespace fathom::calibration

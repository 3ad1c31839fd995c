#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

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
  // Rotation of the right camera from its calibration, about its own x, y and z, that fits the errors best.
  // About y (towards the left camera) it hardly moves epipolar lines: see rotation_sigma.
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();        // [rad]
  Eigen::Vector3d rotation_sigma = Eigen::Vector3d::Zero();  // [rad]
  // Relative growth of the right camera's focal lengths over the left one's.
  double focal = 0, focal_sigma = 0;
  double sigma_after = 0;  // of one match after correction by these [px]
  // Of rotation and focal together: inverse covariance for independent matches.
  Eigen::Matrix4d information = Eigen::Matrix4d::Zero();

  // In the worst part of the image, or of all [px].
  [[nodiscard]] double worst() const;
};

// Least matches for a cell's median.
inline constexpr std::size_t kEnoughInCell = 30;

// Signed distance of the match in the right image from the epipolar line of its left point [px]; positive
// on the side of growing v.
[[nodiscard]] double epipolarError(const StereoRig& rig, const RigMatch& match);

// Robust throughout: up to a third of the matches may be outliers. No matches give zeros.
[[nodiscard]] EpipolarCheck checkEpipolar(const StereoRig& rig, const std::vector<RigMatch>& matches);

// Whether errors exceed kMostMedian over all matches, or kMostCell in a cell. Stereo drops matches 1 px off
// their epipolar line: half of that leaves room for its own noise.
inline constexpr double kMostMedian = 0.5, kMostCell = 0.75;  // [px]
[[nodiscard]] bool hasMoved(const EpipolarCheck& check);
// Whether it has, and `rotation` and `focal` explain the errors: enough matches, which come to their lines.
[[nodiscard]] bool explainsMove(const EpipolarCheck& check);

// Whether `rotation` and `focal` are measured, large or small: enough matches, which come to their lines.
inline constexpr std::size_t kFewestMatches = 500;
[[nodiscard]] bool measuresRig(const EpipolarCheck& check, std::size_t fewest = kFewestMatches);

// changed()'s arguments in words: "the right camera as turned by pitch ..., its focal lengths as ... longer".
[[nodiscard]] std::string describeChange(const Eigen::Vector3d& rotation, double focal);

// The rig with its right camera turned about its own axes [rad] and longer focal lengths (`focal`: logarithm
// of right over left), by half in each camera. Flat ports keep theirs.
[[nodiscard]] StereoRig changed(const StereoRig& rig, const Eigen::Vector3d& rotation, double focal);

// Robust weight of a residual, given in standard deviations: Cauchy's, 95 % efficient for a Gaussian (Holland
// and Welsch 1977).
[[nodiscard]] double cauchyWeight(double sigmas);

}  // namespace fathom::calibration

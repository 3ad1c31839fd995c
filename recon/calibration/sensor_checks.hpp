#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"

// Checks of stereo: its epipolar errors, its ranges against the DVL's, the camera's mounting against compass
// and DVL.

namespace fathom::calibration {

inline constexpr int kEpipolarColumns = 8, kEpipolarRows = 6;

// How a rig differs from its calibration: the right camera turned about its own axes [rad]; its focal lengths
// longer, as logarithm of right over left; its first radial coefficient (k1) greater, as right less left.
struct RigChange {
  static constexpr int kParts = 5;
  using Vector = Eigen::Matrix<double, kParts, 1>;  // in this order
  using Matrix = Eigen::Matrix<double, kParts, kParts>;

  RigChange() = default;
  RigChange(const Eigen::Vector3d& turned, double longer, double more)
      : rotation(turned), focal(longer), radial(more) {}
  explicit RigChange(const Vector& v) : rotation(v.head<3>()), focal(v(3)), radial(v(4)) {}
  [[nodiscard]] Vector vector() const { return (Vector() << rotation, focal, radial).finished(); }

  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  double focal = 0, radial = 0;

  static void exchange(auto& archive, auto& self) { archive(self.rotation, self.focal, self.radial); }
};

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
  // What fits the errors best; no difference in distortion unless it shows clearly. A turn about y (towards
  // the left camera) hardly moves epipolar lines: see change_sigma.
  RigChange change, change_sigma;
  double sigma_after = 0;  // of one match after correction by it [px]
  // Of change.vector(): inverse covariance for independent matches.
  RigChange::Matrix information = RigChange::Matrix::Zero();

  // In the worst part of the image, or of all [px].
  [[nodiscard]] double worst() const { return std::max(std::abs(median), std::abs(worst_cell)); }
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
// Whether it has, and `change` explains the errors: enough matches, which come to their lines.
[[nodiscard]] bool explainsMove(const EpipolarCheck& check);

// Whether `change` is measured, large or small: enough matches, which come to their lines.
inline constexpr std::size_t kFewestMatches = 500;
[[nodiscard]] bool measuresRig(const EpipolarCheck& check, std::size_t fewest = kFewestMatches);

// In words: "the right camera as turned by pitch ..., its focal lengths as ... longer".
[[nodiscard]] std::string describeChange(const RigChange& change);

// The rig with its right camera turned, and focal lengths and distortion changed by half in each camera. Flat
// ports keep theirs.
[[nodiscard]] StereoRig changed(const StereoRig& rig, const RigChange& change);

// Robust weight of a residual, given in standard deviations: Cauchy's, 95 % efficient for a Gaussian (Holland
// and Welsch 1977).
[[nodiscard]] double cauchyWeight(double sigmas);

// Distance of the seafloor below the camera, by stereo and by the DVL [m].
struct RangeSample {
  double stereo = 0, dvl = 0;
};

struct RangeCheck {
  std::size_t samples = 0;
  double ratio = 1, ratio_sigma = 0;  // stereo = ratio * dvl
  double scatter = 0;                 // of one sample about that, relative
  double shortest = 0, longest = 0;   // of the DVL's: 5th and 95th percentile [m]
  // stereo = scale * dvl + offset; only when the ranges span enough to separate the two.
  bool line_known = false;
  double scale = 1, scale_sigma = 0;
  double offset = 0, offset_sigma = 0;  // [m]
};

// Robust: ratio by the median, line by iteratively reweighted least squares (Cauchy). Neighbouring samples
// are of the same seafloor and not independent: standard deviations come from the differences of consecutive
// blocks of samples (in order of time). Fewer than 8 samples give `samples` alone.
[[nodiscard]] RangeCheck checkRanges(const std::vector<RangeSample>& samples);

// Motion between two exposures.
struct MotionStep {
  SE3 T_b1_b0;  // the body's motion by DVL, compass and depth: maps points of body 0 into body 1
  Eigen::Quaterniond R_c1_c0;  // the camera's rotation by visual odometry
  // Middle of the points in view, in camera 0 and in camera 1 [m]. Unlike the camera's translation, it is not
  // correlated with rotation: both places are measured directly.
  Eigen::Vector3d middle0, middle1;
};

// One estimate of the camera's mounting, against the assumed one.
struct MountEstimate {
  bool known = false;                                  // enough steps
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // about body's forward, starboard, down: R_body_cam =
                                                       // exp(rotation) * assumed [rad]
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();     // standard deviations [rad]; infinite: not observable
};

struct MountAlignment {
  std::size_t steps = 0;
  double turned = 0;      // sum of the rotations' lengths [rad]
  double travelled = 0;   // [m]
  MountEstimate compass;  // from rotations alone: camera against compass; needs turns and rolling
  MountEstimate dvl;      // from displacements alone: camera against DVL; open about the direction of travel
  MountEstimate both;     // all together
  double speed_ratio = 1,
         speed_ratio_sigma = 0;  // visual distance over distance by DVL: the baseline's scale
  double rotation_scatter = 0;   // of one step [rad]
  double middle_scatter = 0;     // of one step [m]
};

// Hand-eye calibration of the camera's rotation in body (after Tsai and Lenz 1989, as robust least squares):
//   X R_c1_c0 X' = R_b1_b0,        X middle1 + p = T_b1_b0 (X middle0 + p),      X = R_body_cam, p its place,
// the place being held at `assumed`: it shows in turns alone, and weakly. Fewer than 8 steps give `steps`
// alone.
[[nodiscard]] MountAlignment alignMount(const std::vector<MotionStep>& steps, const SE3& assumed_T_body_cam);

}  // namespace fathom::calibration

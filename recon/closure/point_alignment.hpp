#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "recon/geometry/se3.hpp"

namespace fathom::closure {

// Errors common to all points of a frame, the same in both frames while rig and lamps are: residual
// calibration errors of the disparity, and shading, which draws features towards or away from lamps that move
// with the vehicle. Each is a constant and a slope over the image, the disparity's curved as well, zero-mean
// with these standard deviations. Slopes are by the tangent of the angle from the principal ray, along x and
// y (disparity) or radial (place).
struct SharedErrors {
  double place = 4e-4;            // of a feature, along x and y of the image [tangent]
  double place_slope = 1e-3;      // [tangent by tangent]
  double disparity = 0.03;        // [px]
  double disparity_slope = 0.08;  // [px by tangent]
  double disparity_curve = 0;     // [px by squared tangent], along x and y each
};
// Number of constants and slopes, which alignPoints() estimates with a pose; and of all, with the curves,
// which it does not estimate.
constexpr int kSharedErrors = 6, kCommonErrors = kSharedErrors + 2;
using SharedJacobian = Eigen::Matrix<double, 3, kSharedErrors>;
using CommonJacobian = Eigen::Matrix<double, 3, kCommonErrors>;
using PoseByCommonErrors = Eigen::Matrix<double, 6, kCommonErrors>;

// Disparity error at a tangent by each of the disparity's slopes and curves, the last four of these errors,
// of one standard deviation each [px].
[[nodiscard]] Eigen::RowVector4d unevenDisparity(const SharedErrors& errors, const Eigen::Vector2d& tangent);

// Displacement of a point in the left camera frame by each error of one standard deviation [m]: constants and
// slopes; and these with the curves.
[[nodiscard]] SharedJacobian sharedJacobian(const SharedErrors& errors, double focal_length_px,
                                            double baseline, const Eigen::Vector3d& point);
[[nodiscard]] CommonJacobian commonJacobian(const SharedErrors& errors, double focal_length_px,
                                            double baseline, const Eigen::Vector3d& point);

// Bias of a pose T_a_b that alignPoints() finds over level ground, by each shared error of one standard
// deviation: a column each, the right perturbation (rho, phi) [m], [rad]. All poses of a dive have the same
// errors, so that biases add up: a slope of the disparity turns every step by half of it over its length.
// `focal_length_px`, `baseline` [m]: of the rig; `half_view`: tangents of half the angles of view; `range`:
// to the ground [m]. Zero where the two views do not overlap.
[[nodiscard]] PoseByCommonErrors poseBySharedErrors(const SharedErrors& errors, double focal_length_px,
                                                    double baseline, const Eigen::Vector2d& half_view,
                                                    double range, const SE3& T_a_b);

// One place, measured in the left camera frames of two stereo frames.
struct PointPair {
  Eigen::Vector3d a, b;                        // [m]
  Eigen::Matrix3d covariance_a, covariance_b;  // of each by itself [m^2]
  SharedJacobian shared_a = SharedJacobian::Zero(), shared_b = SharedJacobian::Zero();
};

// T_a_b of unweighted least squares, rotation by Horn's quaternion (1987). std::nullopt for fewer than three
// points or points on one line.
[[nodiscard]] std::optional<SE3> absoluteOrientation(const std::vector<PointPair>& pairs,
                                                     const std::vector<int>& chosen);

// Squared Mahalanobis distance of e = a - T b with the covariance C = A + R B R^T.
[[nodiscard]] double squaredDistance(const PointPair& pair, const SE3& T_a_b,
                                     const Eigen::Matrix3d& rotation);

struct Hypothesis {
  SE3 T_a_b;
  std::vector<int> inliers;  // indices of pairs
  double cost = 0;           // sum over all pairs of min(squared distance, gate)
};

struct SampleConfig {
  int max_samples = 20000;     // minimal sets drawn; most fail at once by triangles of different size
  int max_hypotheses = 400;    // poses computed and scored
  double gate = 11.34;         // squared distance of an inlier: 99 % of chi-square with 3 degrees of freedom
  double confidence = 0.9999;  // of having drawn one clean set; ends the sampling early
  std::uint32_t seed = 1;
};

// Random minimal sets of three (Fischler & Bolles 1981), those whose triangles have different sides dropped,
// scored as MSAC (Torr & Zisserman 2000). `plausible`: false for poses to reject; may be null.
// std::nullopt when no set has another inlier than its own three.
using PoseTest = bool (*)(const void* context, const SE3& T_a_b);
[[nodiscard]] std::optional<Hypothesis> sampleConsensus(const std::vector<PointPair>& pairs,
                                                        const SampleConfig& config, PoseTest plausible,
                                                        const void* context);

// Gauss-Newton over all pairs with the Cauchy kernel, rho(s) = c^2 log(1 + s / c^2) of the squared distance
// s, c = 2.
[[nodiscard]] SE3 refineCauchy(const std::vector<PointPair>& pairs, const SE3& start);

struct Alignment {
  SE3 T_a_b;
  Matrix6d covariance;  // of the right perturbation (rho, phi) [m, rad]
  double noise = 1;     // standard deviation of the residuals over that of the points' covariances
  std::vector<int> inliers;
};

// Maximum likelihood of the pose and the shared errors u ~ N(0, 1), with e = a - T b - (S_a - R S_b) u:
// minimises sum e^T C^-1 e + u^T u over the pairs within 95 % of chi-square (7.815), from `start`; the pairs
// are chosen again after each solution until they stay the same. J = [-R, R [b]x, R S_b - S_a] by (rho, phi,
// u); the covariance is the pose's block of noise^2 (sum J^T C^-1 J + noise^2 [0, 1])^-1. `noise` comes from
// the inliers themselves, corrected for the cut-off tail, within kMinNoise and kMaxNoise. std::nullopt for
// fewer than 4 inliers or a singular problem.
constexpr double kMinNoise = 0.7;
constexpr double kMaxNoise = 3;
[[nodiscard]] std::optional<Alignment> alignPoints(const std::vector<PointPair>& pairs, const SE3& start);

}  // namespace fathom::closure

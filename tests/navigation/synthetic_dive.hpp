#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/navigation/graph/navigation_graph.hpp"

namespace fathom::slam::testing {

struct SyntheticDiveOptions {
  std::uint64_t seed = 1;
  int lines = 4;
  double line_length = 15, line_spacing = 1.2;    // [m]
  double speed = 0.5, interval = 1.0;             // [m/s], between keyframes [s]
  double reach = 0.7;                             // keyframes nearer than this get a closure [m]
  double closure_share = 0.3;                     // of such pairs that are measured
  double visual_share = 1.0;                      // of steps with visual odometry
  double usbl_sigma = 0.5, usbl_period = 10;      // [m], [s]
  double wild_fixes = 0.0;                        // share
  double anchor_sigma = 0.5;                      // [m]
  double dvl_dead_from = 1e9, dvl_dead_to = 1e9;  // [s]; dead reckoning stands still meanwhile
  double jump_at = 1e9, jump = 0;                 // of the compass [s], [rad]
  bool jump_known = true;  // dead reckoning reports it; else only visual odometry shows it
  double outlier_from = 1e9, outlier_to = 1e9,
         outlier = 0;  // false velocity that the DVL adds to starboard [s], [m/s]
  // A magnetic anomaly that the vehicle passes: bump exp(-((t - bump_at) / bump_sigma)^2 / 2) [s], [rad].
  double bump_at = 1e9, bump = 0, bump_sigma = 3;
  // Visual odometry that took another place for the next: so many links, turned by so much in either
  // direction [rad] and shifted [m].
  int false_links = 0;
  double false_turn_least = 0.07, false_turn_most = 0.175, false_shift = 0;
  double scale_at = 1e9, scale_step = 0;           // the DVL's scale changes by so much [s], [1]
  double bias_from = 1e9, bias_to = 1e9;           // USBL errs by `bias` all the while [s]
  Eigen::Vector2d bias = Eigen::Vector2d::Zero();  // [m]
  // All of the USBL's positions: turned about the ship at `ship` [m], clockwise from above [rad].
  double usbl_turn = 0;
  Eigen::Vector2d ship = Eigen::Vector2d::Zero();
  // Gyro: angle random walk [rad/s^(1/2)], constant bias [rad/s]; none: negative.
  double gyro_walk = -1, gyro_bias = 1e-4;
};

// A synthetic lawn-mower survey as the sensors of a vehicle measure it: compass with a deviation over heading
// and time, biased tilt, DVL with scale and misalignment. The magnitudes are a Sirius-class vehicle's by its
// data sheets (synthetic_dive.cpp), whatever the estimator assumes.
struct SyntheticDive {
  struct Link {
    int a = 0, b = 0;
    SE3 T_a_b;
  };
  struct Fix {
    int keyframe = 0;  // nearest
    Eigen::Vector3d antenna_in_odom;
    Eigen::Vector2d north_east;
  };
  std::vector<SE3> truth;  // T_nav_cam of keyframes
  std::vector<KeyframeInput> inputs;
  std::vector<Link> visual;    // of consecutive keyframes
  std::vector<Link> closures;  // by their newer keyframe
  std::vector<Fix> fixes;      // by keyframe
  Matrix6d link_covariance;
  Eigen::Vector2d anchor;  // nav - odom as known at the start [m]
  double dvl_scale = 0, dvl_heading = 0;
  Eigen::Vector2d tilt_bias = Eigen::Vector2d::Zero();  // of roll and pitch [rad]
  std::vector<int> false_visual;                        // indices in `visual`
  std::vector<bool> anomalous;      // by keyframe: the compass errs by more than its noise there
  std::vector<bool> wrong_scale;    // by keyframe: the DVL was wrong on the step to it
  std::vector<std::size_t> biased;  // indices in `fixes`
  std::mt19937_64 random;
};

[[nodiscard]] SyntheticDive makeDive(const SyntheticDiveOptions& options);
// The same survey by a camera that is mounted otherwise: `R` turns its axes into those of the one before.
[[nodiscard]] SyntheticDive mounted(SyntheticDive survey, const Eigen::Quaterniond& R);

// Apparent turn of level ground [rad] at a place in the camera's axes [m], by DvlCalibration's xx, xy,
// yy, w [rad/m]. And all that images saw, of ground that seems so where both cameras saw it.
[[nodiscard]] Eigen::Matrix3d curvedBy(double xx, double xy, double yy, double w);
void turnAll(SyntheticDive& survey, const Eigen::Matrix3d& by);

// Noise of the sensors of such a dive; the default of the estimator is
// larger where a real vehicle may be worse.
[[nodiscard]] SensorNoise syntheticNoise();
// Room for a survey of 400 keyframes.
[[nodiscard]] NavigationConfig smallConfig();

// The survey's links and fixes, as a batch solution takes them.
struct Measured {
  std::vector<NavigationLink> links;
  std::vector<NavigationFix> fixes;
};
[[nodiscard]] Measured measuredOf(const SyntheticDive& survey, double fix_sigma);

// The survey through a graph, as a vehicle would: keyframe, visual odometry, fixes, closures, step.
void drive(NavigationGraph& graph, const SyntheticDive& survey, const SyntheticDiveOptions& options);

// What is measured of a keyframe that the graph has just taken: visual odometry, a step, fixes, closures with
// those that have not retired.
void measure(NavigationGraph& graph, const SyntheticDive& survey, const SyntheticDiveOptions& options,
             int keyframe);

// From the keyframe after the graph's last up to `to`, without the last measurements' settling.
void driveOn(NavigationGraph& graph, const SyntheticDive& survey, const SyntheticDiveOptions& options,
             int to);

// Squared error of a pose over the covariance of its right perturbation: chi-square, 6 degrees of freedom.
[[nodiscard]] double squaredError(const SE3& estimate, const SE3& truth, const Matrix6d& covariance);

[[nodiscard]] std::vector<SE3> posesOf(const NavigationGraph& graph);

// RMS of the horizontal error of dead reckoning or of the graph over all keyframes [m], as it is and after
// the best shift and turn.
struct Errors {
  double absolute = 0, aligned = 0;
};
[[nodiscard]] Errors errorsOf(const std::vector<SE3>& poses, const std::vector<SE3>& truth);

}  // namespace fathom::slam::testing

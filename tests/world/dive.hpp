#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <span>
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
// data sheets (kDvlVelocity and the constants below it), whatever the estimator assumes.
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

// The survey's links and fixes, as a batch solution takes them.
struct Measured {
  std::vector<NavigationLink> links;
  std::vector<NavigationFix> fixes;
};

// RMS of the horizontal error of dead reckoning or of the graph over all keyframes [m], as it is and after
// the best shift and turn.
struct Errors {
  double absolute = 0, aligned = 0;
};

inline constexpr double kSubstep = 0.2;  // DVL ensembles [s]
// Truth's errors, of a Sirius-class vehicle: 1200 kHz DVL (0.2 % +- 2 mm/s), tilt-compensated compass of
// 0.3 degrees, pressure sensor of 0.01 % of 30 m.
inline constexpr double kDvlVelocity = 0.002, kDvlScale = 0.002, kDvlHeading = 0.006;  // [m/s], [1], [rad]
inline constexpr double kHeading = 0.006, kTilt = 0.002, kTiltBias = 0.003;            // [rad]
inline constexpr double kDeviation = 0.021;                  // over the heading [rad]
inline constexpr double kDeviationWalk = 7e-4;               // [rad/s^(1/2)]
inline constexpr double kDepth = 0.003, kDepthBias = 0.002;  // [m]
inline constexpr double kAnomalous = 2;                      // standard deviations of heading

inline std::size_t at(int k) {
  return static_cast<std::size_t>(k);
}

struct Waypoints {
  std::vector<Eigen::Vector2d> at;  // every substep
};

inline Waypoints fly(const SyntheticDiveOptions& o) {
  Waypoints path;
  const double step = o.speed * kSubstep;
  Eigen::Vector2d p(0, 0);
  const auto go = [&](const Eigen::Vector2d& to) {
    const double length = (to - p).norm();
    const int n = static_cast<int>(std::round(length / step));
    for (int i = 0; i < n; ++i) path.at.push_back(p + (to - p) * (i / static_cast<double>(n)));
    p = to;
  };
  for (int line = 0; line < o.lines; ++line) {
    const double east = line * o.line_spacing;
    const bool north = line % 2 == 0;
    go({north ? o.line_length : 0.0, east});
    go({north ? o.line_length : 0.0, east + o.line_spacing});
  }
  go({o.line_length / 2, p.y()});
  go({o.line_length / 2, -1.0});
  return path;
}

[[nodiscard]] inline SyntheticDive makeDive(const SyntheticDiveOptions& o) {
  SyntheticDive s;
  s.random.seed(o.seed * 7919 + 13);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const auto gauss = [&](double sigma) { return sigma * normal(s.random); };
  Vector6d sigma;
  sigma << 0.002, 0.002, 0.003, 0.0015, 0.0015, 0.0015;
  s.link_covariance = sigma.cwiseAbs2().asDiagonal();
  s.dvl_scale = gauss(kDvlScale);
  s.dvl_heading = gauss(kDvlHeading);
  const double iron = 2 * std::numbers::pi * uniform(s.random);
  for (int j = 0; j < 2; ++j) s.tilt_bias(j) = gauss(kTiltBias);
  const double depth_bias = gauss(kDepthBias);
  double drift = 0;
  const auto measured = [&](const SE3& T_a_b) {
    Vector6d e;
    for (int i = 0; i < 6; ++i) e(i) = gauss(sigma(i));
    return perturbed(T_a_b, e);
  };

  const Waypoints path = fly(o);
  const int every = static_cast<int>(std::round(o.interval / kSubstep));
  Eigen::Vector2d odom(0, 0);
  const Eigen::Vector2d start = path.at[0];
  double heading_before = 0, unlocked = 0, next_fix = o.usbl_period;
  bool jumped = false, wrong_dvl = false;
  double heading_last = 0, gyro_turn = 0;
  for (std::size_t i = 0; i + 1 < path.at.size(); ++i) {
    const double t = static_cast<double>(i) * kSubstep;
    const Eigen::Vector2d d = path.at[i + 1] - path.at[i];
    // The hull follows the track with some lag.
    const double track = std::atan2(d.y(), d.x());
    const double heading = i == 0 ? track : heading_before + 0.35 * wrapAngle(track - heading_before);
    heading_before = heading;
    drift += gauss(kDeviationWalk * std::sqrt(kSubstep));
    const double deviation = kDeviation * std::sin(heading + iron) + drift;
    const double jump = t >= o.jump_at && !o.jump_known ? o.jump : 0;
    const double off = (t - o.bump_at) / o.bump_sigma, bump = o.bump * std::exp(-0.5 * off * off);
    const double compass = heading + deviation + jump + bump + gauss(kHeading);
    if (i > 0) gyro_turn += wrapAngle(heading - heading_last) + o.gyro_bias * kSubstep;
    if (i > 0 && o.gyro_walk > 0) gyro_turn += gauss(o.gyro_walk * std::sqrt(kSubstep));
    heading_last = heading;
    const double roll = 0.03 * std::sin(0.9 * t), pitch = 0.02 * std::sin(0.7 * t + 1);
    const double depth = 10 + 0.3 * std::sin(0.05 * t);
    const SE3 truth = SE3::fromEuler(roll, pitch, heading, {path.at[i].x(), path.at[i].y(), depth});
    if (i % static_cast<std::size_t>(every) == 0) {
      const int k = static_cast<int>(s.truth.size());
      KeyframeInput input;
      input.utc_ns = static_cast<std::int64_t>(t * 1e9);
      const double measured_depth = depth + depth_bias + gauss(kDepth);
      input.T_odom_cam =
          SE3::fromEuler(roll + s.tilt_bias.x() + gauss(kTilt), pitch + s.tilt_bias.y() + gauss(kTilt),
                         compass, {odom.x(), odom.y(), measured_depth});
      input.unlocked_s = unlocked;
      input.compass_jumped = !jumped && o.jump_known && t >= o.jump_at;
      jumped = jumped || t >= o.jump_at;
      unlocked = 0;
      if (o.gyro_walk > 0) {
        input.gyro_turn = gyro_turn;
        input.ungyro_s = 0;
      }
      gyro_turn = 0;
      s.anomalous.push_back(std::abs(bump) > kAnomalous * kHeading);
      s.wrong_scale.push_back(wrong_dvl);
      wrong_dvl = false;
      s.truth.push_back(truth);
      s.inputs.push_back(input);
      if (k > 0 && uniform(s.random) < o.visual_share)
        s.visual.push_back({k - 1, k, measured(s.truth[at(k - 1)].inverse() * truth)});
      for (int a = 0; a + 8 < k; ++a)
        if ((s.truth[at(a)].translation() - truth.translation()).head<2>().norm() < o.reach &&
            uniform(s.random) < o.closure_share)
          s.closures.push_back({a, k, measured(s.truth[at(a)].inverse() * truth)});
      if (t >= next_fix) {
        next_fix += o.usbl_period;
        const Eigen::Vector3d lever(-0.4, 0.1, -0.6);
        Eigen::Vector2d fix = (truth * lever).head<2>();
        for (int j = 0; j < 2; ++j) fix(j) += gauss(o.usbl_sigma);
        const double wild = uniform(s.random), direction = 2 * std::numbers::pi * uniform(s.random);
        if (wild < o.wild_fixes) fix += 12.0 * Eigen::Vector2d(std::cos(direction), std::sin(direction));
        fix = o.ship + Eigen::Rotation2Dd(o.usbl_turn) * (fix - o.ship);
        if (t >= o.bias_from && t < o.bias_to) {
          fix += o.bias;
          s.biased.push_back(s.fixes.size());
        }
        s.fixes.push_back({k, input.T_odom_cam * lever, fix});
      }
    }
    const bool dead = t >= o.dvl_dead_from && t < o.dvl_dead_to;
    if (dead) {
      unlocked += kSubstep;
      continue;
    }
    Eigen::Vector2d velocity = Eigen::Rotation2Dd(-heading) * d / kSubstep;
    velocity = (1 + s.dvl_scale) * (Eigen::Rotation2Dd(-s.dvl_heading) * velocity);
    if (t >= o.outlier_from && t < o.outlier_to) velocity.y() += o.outlier;
    if (t >= o.scale_at) velocity *= 1 + o.scale_step;
    wrong_dvl = wrong_dvl || (t >= o.outlier_from && t < o.outlier_to) || t >= o.scale_at;
    for (int j = 0; j < 2; ++j) velocity(j) += gauss(kDvlVelocity);
    odom += Eigen::Rotation2Dd(compass) * velocity * kSubstep;
  }
  for (int n = 0; n < o.false_links && !s.visual.empty(); ++n) {
    const auto k = static_cast<std::size_t>(uniform(s.random) * static_cast<double>(s.visual.size()));
    const double turn = o.false_turn_least + (o.false_turn_most - o.false_turn_least) * uniform(s.random);
    const double side = uniform(s.random) < 0.5 ? -1 : 1, to = 2 * std::numbers::pi * uniform(s.random);
    const SE3 wrong =
        SE3::fromEuler(0, 0, side * turn, o.false_shift * Eigen::Vector3d(std::cos(to), std::sin(to), 0));
    SE3& T_a_b = s.visual[k].T_a_b;
    T_a_b = uniform(s.random) < 0.5 ? wrong * T_a_b : T_a_b * wrong;
    s.false_visual.push_back(static_cast<int>(k));
  }
  s.anchor = start;
  for (int j = 0; j < 2; ++j) s.anchor(j) += gauss(o.anchor_sigma);
  return s;
}

// Apparent turn of level ground [rad] at a place in the camera's axes [m], by DvlCalibration's xx, xy,
// yy, w [rad/m]. And all that images saw, of ground that seems so where both cameras saw it.
[[nodiscard]] inline Eigen::Matrix3d curvedBy(double xx, double xy, double yy, double w) {
  Eigen::Matrix3d by;
  by << -xy, -yy, 0, xx, xy, 0, 0, -w, 0;
  return by;
}

inline void turnAll(SyntheticDive& survey, const Eigen::Matrix3d& by) {
  constexpr double kRange = 2;  // [m]
  for (auto* links : {&survey.visual, &survey.closures})
    for (SyntheticDive::Link& link : *links) {
      const Eigen::Vector3d ahead = kRange * Eigen::Vector3d::UnitZ(),
                            ground = 0.5 * (ahead + link.T_a_b.inverse() * ahead);
      Vector6d turn;
      turn.tail<3>() = link.T_a_b.rotation().conjugate() * (by * (link.T_a_b * ground)) - by * ground;
      turn.head<3>() = ground.cross(Eigen::Vector3d(turn.tail<3>()));
      link.T_a_b = link.T_a_b * SE3::exp(turn);
    }
}

// Noise of the sensors of such a dive; the default of the estimator is
// larger where a real vehicle may be worse.
[[nodiscard]] inline SensorNoise syntheticNoise() {
  SensorNoise noise;
  noise.heading_lag = noise.usbl_shift = noise.usbl_turn = 0;
  noise.dvl_wander = noise.visual_scale = 0;
  noise.deviation = kDeviation / std::numbers::sqrt2;
  noise.tilt_bias = kTiltBias;
  noise.tilt_turn = 0.003;
  noise.depth_offset = kDepthBias;
  noise.depth_drift = 0;
  return noise;
}

// Room for a survey of 400 keyframes.
[[nodiscard]] inline NavigationConfig smallConfig() {
  NavigationConfig config;
  config.max_keyframes = 400;
  config.max_links = 2000;
  config.max_fixes = 200;
  return config;
}

[[nodiscard]] inline Measured measuredOf(const SyntheticDive& s, double fix_sigma) {
  Measured out;
  for (const auto* list : {&s.visual, &s.closures})
    for (const SyntheticDive::Link& l : *list) {
      out.links.push_back({.a = static_cast<std::uint32_t>(l.a),
                           .b = static_cast<std::uint32_t>(l.b),
                           .T_a_b = l.T_a_b,
                           .covariance = s.link_covariance});
    }
  for (const SyntheticDive::Fix& f : s.fixes)
    out.fixes.push_back({f.keyframe, f.antenna_in_odom, f.north_east, fix_sigma, true});
  return out;
}

// The items of a sorted list whose `key` is `k` (clang 14 cannot read the library's subranges).
template <typename Item>
std::span<const Item> itemsOf(const std::vector<Item>& sorted, int Item::*key, int k) {
  return {std::ranges::lower_bound(sorted, k, {}, key), std::ranges::upper_bound(sorted, k, {}, key)};
}

// What is measured of a keyframe that the graph has just taken: visual odometry, a step, fixes, closures with
// those that have not retired.
inline void measure(NavigationGraph& graph, const SyntheticDive& s, const SyntheticDiveOptions& o, int k) {
  for (const SyntheticDive::Link& link : itemsOf(s.visual, &SyntheticDive::Link::b, k))
    (void)graph.addLink(LinkKind::kOdometry, k - 1, k, link.T_a_b, s.link_covariance);
  (void)graph.step();
  for (const SyntheticDive::Fix& fix : itemsOf(s.fixes, &SyntheticDive::Fix::keyframe, k))
    (void)graph.addFix(k, fix.antenna_in_odom, fix.north_east, o.usbl_sigma, true);
  for (const SyntheticDive::Link& link : itemsOf(s.closures, &SyntheticDive::Link::b, k))
    if (graph.has(link.a)) (void)graph.addLink(LinkKind::kClosure, link.a, k, link.T_a_b, s.link_covariance);
}

// From the keyframe after the graph's last up to `to`, without the last measurements' settling.
inline void driveOn(NavigationGraph& graph, const SyntheticDive& s, const SyntheticDiveOptions& o, int to) {
  for (int k = graph.keyframes(); k < to; ++k) {
    if (!graph.addKeyframe(s.inputs[at(k)])) return;
    measure(graph, s, o, k);
  }
}

// The survey through a graph, as a vehicle would: keyframe, visual odometry, fixes, closures, step.
inline void drive(NavigationGraph& graph, const SyntheticDive& s, const SyntheticDiveOptions& o) {
  graph.setAnchor(s.anchor, o.anchor_sigma);
  driveOn(graph, s, o, static_cast<int>(s.inputs.size()));
  // The last measurements settle.
  for (int i = 0; i < 30; ++i) (void)graph.step();
}

[[nodiscard]] inline std::vector<SE3> posesOf(const NavigationGraph& graph) {
  std::vector<SE3> poses;
  for (int k = 0; k < graph.keyframes(); ++k) poses.push_back(graph.pose(k));
  return poses;
}

// Squared error of a pose over the covariance of its right perturbation: chi-square, 6 degrees of freedom.
[[nodiscard]] inline double squaredError(const SE3& estimate, const SE3& truth, const Matrix6d& covariance) {
  const SE3 off = estimate.inverse() * truth;
  Vector6d e;
  e << off.translation(), (off.rotation().w() < 0 ? -2 : 2) * off.rotation().vec();
  return e.dot(covariance.ldlt().solve(e));
}

[[nodiscard]] inline Errors errorsOf(const std::vector<SE3>& poses, const std::vector<SE3>& truth) {
  const double n = static_cast<double>(poses.size());
  Eigen::Vector2d from(0, 0), to(0, 0);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    from += poses[k].translation().head<2>() / n;
    to += truth[k].translation().head<2>() / n;
  }
  // The turn that fits best (Kabsch, in the plane).
  double dot = 0, cross = 0;
  const auto pair = [&](std::size_t k) {
    return std::pair<Eigen::Vector2d, Eigen::Vector2d>(poses[k].translation().head<2>() - from,
                                                       truth[k].translation().head<2>() - to);
  };
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const auto [p, q] = pair(k);
    dot += p.dot(q);
    cross += p.x() * q.y() - p.y() * q.x();
  }
  const Eigen::Rotation2Dd turn(std::atan2(cross, dot));
  double absolute = 0, aligned = 0;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const auto [p, q] = pair(k);
    absolute += (poses[k].translation() - truth[k].translation()).head<2>().squaredNorm();
    aligned += (turn * p - q).squaredNorm();
  }
  return {std::sqrt(absolute / n), std::sqrt(aligned / n)};
}

// The same survey by a camera that is mounted otherwise: `R` turns its axes into those of the one before.
[[nodiscard]] inline SyntheticDive mounted(SyntheticDive survey, const Eigen::Quaterniond& R) {
  const SE3 mounting(R, Eigen::Vector3d::Zero()), back = mounting.inverse();
  for (SE3& pose : survey.truth) pose = pose * mounting;
  for (KeyframeInput& input : survey.inputs) input.T_odom_cam = input.T_odom_cam * mounting;
  for (auto* links : {&survey.visual, &survey.closures})
    for (SyntheticDive::Link& link : *links) link.T_a_b = back * link.T_a_b * mounting;
  const Matrix6d turn = adjoint(back);
  survey.link_covariance = turn * survey.link_covariance * turn.transpose();
  return survey;
}

}  // namespace fathom::slam::testing

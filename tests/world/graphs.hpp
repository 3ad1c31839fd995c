#pragma once

#include <Eigen/Core>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "recon/solver/incremental/incremental_solver.hpp"
#include "recon/solver/measurements.hpp"
#include "recon/solver/pose_graph.hpp"

namespace fathom::test {

// Ends of a synthetic survey's loop closures.
enum class Closures {
  kNeighbours,  // neighbouring lines and crossing lines, as footprints overlap
  kAnywhere     // any two keyframes: the worst case for a solver
};

struct SurveyPlan {
  int keyframes = 20000;
  int closures = 2000;
  Closures where = Closures::kNeighbours;
  double spacing = 0.9;             // of keyframes along the track [m]
  double line_length = 200;         // [m]
  double line_spacing = 2.5;        // [m]
  double cross_line_spacing = 8;    // [m]
  double share_of_lines = 0.8;      // of keyframes; the rest are on cross lines, which come last
  double odometry_shift = 0.01;     // standard deviations, between keyframes [m]
  double odometry_turn = 0.001;     // [rad]
  double closure_shift = 0.02;      // of a closure [m]
  double closure_turn = 0.005;      // [rad]
  double overlap = 2.6;             // farthest that two keyframes of a closure are apart [m]
  bool attitude_and_depth = false;  // one more measurement of each pose, of tilt, heading and depth
  unsigned seed = 1;
};

struct Survey {
  slam::PoseGraph graph;  // its poses are dead reckoning
  std::vector<SE3> truth;
};

using slam::RelativePose;

inline std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

// Keyframes along lines and then cross lines, each line against the one before; turns take no room.
inline std::vector<SE3> trackOf(const SurveyPlan& plan) {
  std::vector<SE3> track;
  const int on_lines = static_cast<int>(plan.share_of_lines * plan.keyframes);
  const int per_line = std::max(1, static_cast<int>(plan.line_length / plan.spacing));
  const double width = plan.line_spacing * std::ceil(static_cast<double>(on_lines) / per_line);
  for (int i = 0; i < on_lines; ++i) {
    const int line = i / per_line, along = i % per_line;
    const bool back = line % 2 == 1;
    const double x = plan.spacing * (back ? per_line - 1 - along : along);
    track.push_back(SE3::fromEuler(0, 0, back ? std::numbers::pi : 0, {x, plan.line_spacing * line, 0}));
  }
  const int per_cross = std::max(1, static_cast<int>(width / plan.spacing));
  for (int i = 0; i < plan.keyframes - on_lines; ++i) {
    const int line = i / per_cross, along = i % per_cross;
    const bool back = line % 2 == 0;
    const double y = plan.spacing * (back ? per_cross - 1 - along : along);
    track.push_back(SE3::fromEuler(0, 0, back ? -std::numbers::pi / 2 : std::numbers::pi / 2,
                                   {plan.cross_line_spacing * (line + 0.5), y, 0}));
  }
  return track;
}

// Pairs of keyframes that see the same ground and are not of one stretch of the track.
inline std::vector<std::pair<int, int>> overlaps(const std::vector<SE3>& track, double reach) {
  constexpr int kSameStretch = 20;
  std::map<std::pair<int, int>, std::vector<int>> cells;
  const auto cellOf = [&](const SE3& pose) {
    return std::pair{static_cast<int>(std::floor(pose.translation().x() / reach)),
                     static_cast<int>(std::floor(pose.translation().y() / reach))};
  };
  std::vector<std::pair<int, int>> pairs;
  for (int i = 0; i < static_cast<int>(track.size()); ++i) {
    const auto [cx, cy] = cellOf(track[index(i)]);
    for (int x = cx - 1; x <= cx + 1; ++x) {
      for (int y = cy - 1; y <= cy + 1; ++y) {
        const auto cell = cells.find({x, y});
        if (cell == cells.end()) continue;
        for (const int k : cell->second)
          if (i - k > kSameStretch &&
              (track[index(i)].translation() - track[index(k)].translation()).norm() < reach)
            pairs.emplace_back(k, i);
      }
    }
    cells[{cx, cy}].push_back(i);
  }
  return pairs;
}

inline Matrix6d informationOf(double shift, double turn) {
  Vector6d diagonal;
  // The residual's last three numbers are half angles.
  diagonal << Eigen::Vector3d::Constant(1 / (shift * shift)), Eigen::Vector3d::Constant(4 / (turn * turn));
  return diagonal.asDiagonal();
}

// A lawn-mower survey with cross lines, at 2 m over a plane. The same plan gives the same survey.
[[nodiscard]] inline Survey makeSurvey(const SurveyPlan& plan) {
  Survey survey;
  survey.truth = trackOf(plan);
  std::mt19937_64 random(plan.seed);
  std::normal_distribution<double> normal;
  const auto noise = [&](double shift, double turn) {
    Vector6d x;
    for (int i = 0; i < 6; ++i) x(i) = (i < 3 ? shift : turn) * normal(random);
    return SE3::exp(x);
  };
  const auto between = [&](int a, int b) {
    return survey.truth[index(a)].inverse() * survey.truth[index(b)];
  };
  std::vector<RelativePose>& edges = survey.graph.edges;
  survey.graph.poses.push_back(survey.truth.front());
  for (int i = 1; i < plan.keyframes; ++i) {
    edges.push_back({i - 1, i, between(i - 1, i) * noise(plan.odometry_shift, plan.odometry_turn),
                     informationOf(plan.odometry_shift, plan.odometry_turn)});
    survey.graph.poses.push_back(survey.graph.poses.back() * edges.back().T_from_to);
  }
  std::set<std::pair<int, int>> chosen;
  const auto near = overlaps(survey.truth, plan.overlap);
  const std::size_t wanted = plan.where == Closures::kNeighbours ? std::min(index(plan.closures), near.size())
                                                                 : index(plan.closures);
  while (chosen.size() < wanted) {
    if (plan.where == Closures::kNeighbours) {
      chosen.insert(near[random() % near.size()]);
    } else {
      const int a = static_cast<int>(random() % index(plan.keyframes)),
                b = static_cast<int>(random() % index(plan.keyframes));
      if (std::abs(a - b) > 1) chosen.insert({std::min(a, b), std::max(a, b)});
    }
  }
  for (const auto& [a, b] : chosen)
    edges.push_back({a, b, between(a, b) * noise(plan.closure_shift, plan.closure_turn),
                     informationOf(plan.closure_shift, plan.closure_turn)});
  if (plan.attitude_and_depth) {
    constexpr double kDepth = 0.01, kTilt = 0.005, kHeading = 0.02, kUnknown = 1e6;  // [m], [rad]
    Vector6d sigma;
    sigma << kUnknown, kUnknown, kDepth, kTilt / 2, kTilt / 2, kHeading / 2;
    for (int i = 0; i < plan.keyframes; ++i) {
      Vector6d x = Vector6d::Zero();
      x << 0, 0, kDepth * normal(random), kTilt * normal(random), kTilt * normal(random),
          kHeading * normal(random);
      edges.push_back({slam::kWorld, i, survey.truth[index(i)] * SE3::exp(x),
                       sigma.cwiseAbs2().cwiseInverse().asDiagonal()});
    }
  }
  for (int i = 0; i < plan.keyframes; ++i) survey.graph.ids.push_back(i);
  return survey;
}

}  // namespace fathom::test

namespace fathom::slam {

// Normal equations of a small graph as one dense matrix.

[[nodiscard]] inline Eigen::MatrixXd informationOf(const std::vector<SE3>& poses,
                                                   std::span<const RelativePose> edges) {
  const auto n = static_cast<Eigen::Index>(6 * poses.size());
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
  for (const RelativePose& e : edges) {
    const RelativePoseLinear l =
        linearize(e, e.from == kWorld ? SE3() : poses[static_cast<std::size_t>(e.from)],
                  poses[static_cast<std::size_t>(e.to)]);
    Eigen::MatrixXd row = Eigen::MatrixXd::Zero(6, n);
    if (e.from != kWorld) row.middleCols<6>(6 * e.from) = l.by_from;
    row.middleCols<6>(6 * e.to) = l.by_to;
    information += row.transpose() * e.information * row;
  }
  return information;
}

// Of all poses but the first, once that one has been eliminated, from informationOf().
[[nodiscard]] inline Eigen::MatrixXd marginalOf(const Eigen::MatrixXd& information) {
  const Eigen::Index n = information.rows() - 6;
  const Matrix6d first = information.topLeftCorner<6, 6>();
  return information.bottomRightCorner(n, n) -
         information.bottomLeftCorner(n, 6) * first.ldlt().solve(information.topRightCorner(6, n));
}

// Covariance of every pose but the first, which is held, from the whole matrix.
[[nodiscard]] inline Eigen::MatrixXd covarianceOf(const std::vector<SE3>& poses,
                                                  std::span<const RelativePose> edges) {
  const Eigen::MatrixXd information = informationOf(poses, edges);
  const Eigen::Index n = information.rows() - 6;
  return information.bottomRightCorner(n, n).llt().solve(Eigen::MatrixXd::Identity(n, n));
}

// Of two poses together, from covarianceOf().
[[nodiscard]] inline Eigen::MatrixXd jointOf(const Eigen::MatrixXd& covariance, int a, int b) {
  const auto block = [&](int x, int y) { return covariance.block<6, 6>(6 * (x - 1), 6 * (y - 1)); };
  Eigen::MatrixXd both(12, 12);
  both << block(a, a), block(a, b), block(b, a), block(b, b);
  return both;
}

// Whether a symmetric matrix has no eigenvalue below -`tolerance`.
[[nodiscard]] inline bool isPositive(const Eigen::MatrixXd& m, double tolerance) {
  const Eigen::MatrixXd raised = m + tolerance * Eigen::MatrixXd::Identity(m.rows(), m.cols());
  return raised.llt().info() == Eigen::Success;
}

// All that a solver has, its weights in the informations.
[[nodiscard]] inline std::vector<RelativePose> measurementsOf(const IncrementalSolver& solver) {
  std::vector<RelativePose> all;
  for (int k = 0; k < solver.measurements(); ++k) {
    const Measurement& m = solver.measurement(k);
    if (m.in_use) all.push_back({m.from, m.to, m.T_from_to, m.weight * m.root.transpose() * m.root});
  }
  return all;
}

}  // namespace fathom::slam

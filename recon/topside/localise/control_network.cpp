#include "recon/topside/localise/control_network.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "recon/calibration/rig_history.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"
#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/batch/graph_covariance.hpp"

namespace fathom::topside {
namespace {

constexpr double kUnsurveyed = 1e3;            // of a point that nobody surveyed [m]
constexpr double kPinned = 1e-4, kFree = 1e3;  // points have no attitude; marks do not tell one [rad]
constexpr double kStep = 0.002;                // of scale, to find its best [1]

std::size_t at(int i) {
  return static_cast<std::size_t>(i);
}

SE3 placed(const Eigen::Vector3d& place) {
  return {Eigen::Quaterniond::Identity(), place};
}

}  // namespace

StereoRig grown(const StereoRig& rig, double scale) {
  return calibration::withoutRangeError(rig, {-std::log(scale), 0});
}

struct ControlNetwork::State {
  std::vector<SE3> poses;  // points behind the network's
  double cost = 0, scale = 1;
  bool converged = false;
};

ControlNetwork::ControlNetwork(const ControlPoints& control, std::span<const ControlSighting> sightings,
                               const StereoRig& rig, const Frames& frames)
    : control_(control), rig_(rig), frames_(frames), left_out_(control.points.size(), false) {
  for (const ControlSighting& seen : sightings) {
    const auto frame = std::lower_bound(frames.pair.begin(), frames.pair.end(), seen.pair);
    if (frame == frames.pair.end() || *frame != seen.pair) continue;
    if (auto mark = markOf(seen, static_cast<std::uint32_t>(frame - frames.pair.begin())))
      marks_.push_back(*mark);
  }
}

// Inverse ranges of a plane are linear over the image, as homographies have it.
std::optional<ControlNetwork::Mark> ControlNetwork::markOf(const ControlSighting& seen,
                                                           std::uint32_t frame) const {
  constexpr std::size_t kNear = 8, kFew = 4;         // features that tell the ground about a mark
  constexpr double kOfRange = 0.01, kUnknown = 0.1;  // what a target stands off that by; without [1]
  double range = frames_.range[frame], sigma = kUnknown * range;
  closure::FrameFeatures features;
  if (!frames_.blank(frame)) frames_.load(frame, features);
  if (features.size() >= kFew) {
    std::vector<std::pair<double, std::size_t>> near;
    const auto pixelOf = [&](std::size_t k) -> Eigen::Vector2d {
      const closure::Feature& f = features.features[k];
      return (seen.left ? f.left : f.right).cast<double>() - seen.pixel;
    };
    for (std::size_t k = 0; k < features.size(); ++k) near.emplace_back(pixelOf(k).squaredNorm(), k);
    std::sort(near.begin(), near.end());
    near.resize(std::min(near.size(), kNear));
    Eigen::MatrixX3d by(near.size(), 3);
    Eigen::VectorXd inverse(near.size());
    for (std::size_t k = 0; k < near.size(); ++k) {
      const auto row = static_cast<Eigen::Index>(k);
      const Eigen::Vector2d off = pixelOf(near[k].second);
      by.row(row) << 1, off.x(), off.y();
      inverse(row) = 1.0 / static_cast<double>(features.features[near[k].second].point.z());
    }
    const Eigen::Vector3d plane = by.colPivHouseholderQr().solve(inverse);
    const double lowest = inverse.minCoeff(), highest = inverse.maxCoeff();
    // Beyond the features a plane may run anywhere.
    range = 1 / std::clamp(plane.x(), lowest, highest);
    const double left = (by * plane - inverse).norm() / std::sqrt(static_cast<double>(near.size()));
    sigma = hypotenuse(left * range * range, kOfRange * range);
  }
  const Camera& camera = seen.left ? rig_.left : rig_.right;
  const SE3 T_left_camera = seen.left ? SE3() : rig_.T_right_left.inverse();
  const Eigen::Vector3d ray = (T_left_camera.rotation() * camera.ray(seen.pixel)).normalized();
  if (!(ray.z() > 0)) return {};
  Mark mark;
  mark.seen = seen;
  mark.frame = frame;
  mark.place = T_left_camera.translation() + ray * ((range - T_left_camera.translation().z()) / ray.z());
  const double across = seen.sigma * mark.place.norm() / camera.fx, along = sigma / ray.z();
  const Eigen::Matrix3d of_ray = ray * ray.transpose();
  mark.covariance = across * across * (Eigen::Matrix3d::Identity() - of_ray) + along * along * of_ray;
  return mark;
}

bool ControlNetwork::holds(std::uint32_t point) const {
  return control_.points[point].place && !control_.points[point].check && !left_out_[point];
}

bool ControlNetwork::tellsScale() const {
  std::vector<bool> seen(control_.points.size(), false);
  for (const Mark& mark : marks_)
    if (mark.used) seen[mark.seen.point] = true;
  int surveyed = 0;
  for (std::uint32_t k = 0; k < seen.size(); ++k) surveyed += seen[k] && holds(k) ? 1 : 0;
  return surveyed > 1 || std::any_of(control_.bars.begin(), control_.bars.end(), [&](const auto& bar) {
           return !bar.check && seen[bar.from] && seen[bar.to];
         });
}

std::vector<std::optional<Eigen::Vector3d>> ControlNetwork::placesAt(std::span<const SE3> poses,
                                                                     const std::vector<bool>& of) const {
  struct Sum {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d place = Eigen::Vector3d::Zero();
    bool used = false;
  };
  std::vector<Sum> sums(control_.points.size());
  for (const bool used : {true, false})
    for (const Mark& mark : marks_) {
      Sum& sum = sums[mark.seen.point];
      // One of which no mark is left is where they have it all the same.
      if (!of[mark.frame] || mark.used != used || (!used && sum.used)) continue;
      const Eigen::Matrix3d R = poses[mark.frame].matrix3();
      const Eigen::Matrix3d information = R * mark.covariance.inverse() * R.transpose();
      sum.information += information;
      sum.place += information * (poses[mark.frame] * mark.place);
      sum.used = used;
    }
  std::vector<std::optional<Eigen::Vector3d>> out;
  for (const Sum& sum : sums)
    out.push_back(sum.information.isZero(0) ? std::optional<Eigen::Vector3d>()
                                            : Eigen::Vector3d(sum.information.ldlt().solve(sum.place)));
  return out;
}

// Points and what is known of them, behind a network whose visual edges are scaled. Each point keeps its
// attitude to the first camera that marked it: so the direction of a bar turns with the network.
void ControlNetwork::append(const Solved& network, double scale, slam::PoseGraph& graph) const {
  for (std::size_t k = graph.ids.size(); k < graph.poses.size(); ++k)
    graph.ids.push_back(static_cast<std::int64_t>(k));
  for (const std::size_t edge : network.visual) {
    SE3& T = graph.edges[edge].T_from_to;
    T = grown(T, scale);
  }
  const auto first = static_cast<int>(graph.poses.size() - control_.points.size());
  const auto nodeOf = [&](std::uint32_t point) { return first + static_cast<int>(point); };
  const auto join = [&](int from, int to, const Eigen::Vector3d& place, const Eigen::Matrix3d& covariance,
                        double turn) {
    const Eigen::Quaterniond R =
        graph.poses[at(from)].rotation().conjugate() * graph.poses[at(to)].rotation();
    Matrix6d both = Matrix6d::Identity() * turn * turn;
    both.topLeftCorner<3, 3>() = R.conjugate() * covariance * R.toRotationMatrix();
    graph.edges.push_back(slam::linkFactor(from, to, SE3(R, place), both));
  };
  std::vector<bool> pinned(control_.points.size(), false);
  for (const Mark& mark : marks_) {
    const std::uint32_t point = mark.seen.point;
    if (!mark.used) continue;
    join(network.nodes[mark.frame], nodeOf(point), scale * mark.place, mark.covariance,
         pinned[point] ? kFree : kPinned);
    pinned[point] = true;
  }
  for (std::uint32_t k = 0; k < control_.points.size(); ++k) {
    const ControlPoints::Point& point = control_.points[k];
    const Eigen::Vector3d sigma = holds(k) ? Eigen::Vector3d(looser_ * point.sigma)
                                           : Eigen::Vector3d(Eigen::Vector3d::Constant(kUnsurveyed));
    join(network.origin, nodeOf(k), holds(k) ? *point.place : graph.poses[at(nodeOf(k))].translation(),
         sigma.cwiseAbs2().asDiagonal(), pinned[k] ? kFree : kPinned);
  }
  for (const ControlPoints::Bar& bar : control_.bars) {
    if (bar.check) continue;
    const SE3 &a = graph.poses[at(nodeOf(bar.from))], &b = graph.poses[at(nodeOf(bar.to))];
    const Eigen::Vector3d along = (b.translation() - a.translation()).normalized();
    if (!along.allFinite()) continue;
    const Eigen::Vector3d in_b = b.rotation().conjugate() * along;
    Matrix6d information = Matrix6d::Zero();
    information.topLeftCorner<3, 3>() = in_b * in_b.transpose() / (bar.sigma * bar.sigma);
    graph.edges.push_back({nodeOf(bar.from), nodeOf(bar.to),
                           SE3(a.rotation().conjugate() * b.rotation(),
                               a.rotation().conjugate() * Eigen::Vector3d(bar.length * along)),
                           slam::residualInformation(information)});
  }
}

ControlNetwork::State ControlNetwork::solved(const Solved& network, double scale,
                                             const std::vector<SE3>& start) const {
  constexpr int kMarkRounds = 3;  // bars and marks turn with what is found
  State state{start, 0, scale, true};
  for (int round = 0; round < kMarkRounds; ++round) {
    slam::PoseGraph graph = *network.graph;
    graph.poses = state.poses;
    append(network, scale, graph);
    const slam::BatchResult result = slam::optimize(graph, {.chordal = false});
    state.converged = result.converged;
    state.cost = result.chi2;
    state.poses = std::move(graph.poses);
  }
  const double off = network.scale_sigma > 0 ? (scale - 1) / network.scale_sigma : 0;
  state.cost += off * off;
  return state;
}

// Marks and surveys that contradict most, where chance does not explain them.
bool ControlNetwork::leaveOut(const Solved& network, const State& state) {
  constexpr double kGate = 16.27, kUsual = 2.366;  // chi-square, 3 degrees of freedom: 99.9 %, median
  constexpr double kNearWorst = 0.5;
  const std::size_t first = state.poses.size() - control_.points.size();
  std::vector<double> all;
  std::vector<std::pair<double, Mark*>> of;
  for (Mark& mark : marks_) {
    if (!mark.used) continue;
    const Eigen::Vector3d off = state.poses[at(network.nodes[mark.frame])].inverse() *
                                    state.poses[first + mark.seen.point].translation() -
                                state.scale * mark.place;
    of.emplace_back(off.dot(mark.covariance.ldlt().solve(off)), &mark);
    all.push_back(of.back().first);
  }
  const double gate = kGate * std::max(1.0, median(all) / kUsual);
  const double worst = all.empty() ? 0 : *std::max_element(all.begin(), all.end());
  bool any = worst > gate;
  for (const auto& [chi2, mark] : of)
    if (chi2 > std::max(gate, kNearWorst * worst)) mark->used = false;

  std::vector<double> surveys(control_.points.size(), 0);
  for (std::uint32_t k = 0; k < surveys.size(); ++k)
    if (holds(k))
      surveys[k] = ((state.poses[first + k].translation() - *control_.points[k].place).array() /
                    (looser_ * control_.points[k].sigma).array())
                       .square()
                       .sum();
  const auto farthest = std::max_element(surveys.begin(), surveys.end());
  if (farthest != surveys.end() && *farthest > kGate) {
    left_out_[static_cast<std::size_t>(farthest - surveys.begin())] = true;
    any = true;
  }
  return any;
}

ControlResult ControlNetwork::adjust(Solved& network) {
  // Surveys are loose at first: one that is far off then stands out, where it would bend the network.
  constexpr double kLoosest = 32, kTighter = 3.2;
  constexpr int kScales = 6;
  looser_ = kLoosest;
  const std::size_t before = network.graph->poses.size();
  ControlResult out;
  out.scaled = tellsScale();
  out.scale = network.scale;
  State state;
  state.poses = network.graph->poses;
  {
    std::vector<SE3> frames;
    for (const int node : network.nodes) frames.push_back(state.poses[at(node)]);
    const auto places = placesAt(frames, std::vector<bool>(frames.size(), true));
    for (std::uint32_t k = 0; k < places.size(); ++k)
      state.poses.push_back(
          placed(places[k] ? *places[k] : control_.points[k].place.value_or(Eigen::Vector3d::Zero())));
  }
  std::vector<Eigen::Vector3d> by_scale(control_.points.size(), Eigen::Vector3d::Zero());
  for (;;) {
    double moved = 2 * kStep;
    for (int step = 0; out.scaled && std::abs(moved) > kStep && step < kScales; ++step) {
      state = solved(network, out.scale, state.poses);
      const State less = solved(network, out.scale - kStep, state.poses),
                  more = solved(network, out.scale + kStep, state.poses);
      const double slope = (more.cost - less.cost) / (2 * kStep),
                   curve = (more.cost + less.cost - 2 * state.cost) / (kStep * kStep);
      if (!(curve > 0)) break;
      moved = std::clamp(-slope / curve, -50 * kStep, 50 * kStep);
      out.scale += moved;
      out.scale_sigma = std::sqrt(2 / curve);
      for (std::size_t k = 0; k < by_scale.size(); ++k)
        by_scale[k] =
            (more.poses[before + k].translation() - less.poses[before + k].translation()) / (2 * kStep);
    }
    state = solved(network, out.scale, state.poses);
    if (leaveOut(network, state)) {
      out.scaled = tellsScale();
    } else {
      if (looser_ == 1) break;
      looser_ = std::max(1.0, looser_ / kTighter);
    }
  }
  if (!out.scaled) out.scale_sigma = 0;
  out.converged = state.converged;
  slam::PoseGraph& graph = *network.graph;
  graph.poses = state.poses;
  append(network, out.scale, graph);

  report(network, by_scale, out);
  return out;
}

void ControlNetwork::report(const Solved& network, const std::vector<Eigen::Vector3d>& by_scale,
                            ControlResult& out) {
  const slam::PoseGraph& graph = *network.graph;
  const slam::GraphCovariance known(graph);
  const std::size_t first = graph.poses.size() - control_.points.size();
  std::vector<SE3> frames;
  for (const int node : network.nodes) frames.push_back(graph.poses[at(node)]);
  for (Mark& mark : marks_) mark.place *= out.scale;
  const auto seen = placesAt(frames, std::vector<bool>(frames.size(), true));
  const StereoRig rig = grown(rig_, out.scale);
  for (std::uint32_t k = 0; k < control_.points.size(); ++k) {
    const ControlPoints::Point& point = control_.points[k];
    ControlResult::Point& result = out.points.emplace_back();
    result.name = point.name;
    result.surveyed = point.place.has_value();
    result.check = point.check;
    result.left_out = left_out_[k];
    const auto node = static_cast<int>(first + k);
    result.place = graph.poses[at(node)].translation();
    double squares = 0;
    for (const Mark& mark : marks_) {
      if (mark.seen.point != k) continue;
      ++(mark.used ? result.marks : result.marks_left_out);
      if (!mark.used) continue;
      const Eigen::Vector3d p = frames[mark.frame].inverse() * result.place;
      const Eigen::Vector2d pixel =
          mark.seen.left ? rig.left.project(p) : rig.right.project(rig.T_right_left * p);
      squares += (pixel - mark.seen.pixel).squaredNorm() / 2;
    }
    if (result.marks > 0) result.pixel_rms = std::sqrt(squares / result.marks);
    if (result.marks == 0 && seen[k]) result.place = *seen[k];
    const Eigen::Matrix3d R = graph.poses[at(node)].matrix3();
    const Eigen::Matrix3d in_nav = R * known.of(node).topLeftCorner<3, 3>() * R.transpose();
    const Eigen::Vector3d claimed = in_nav.diagonal() + (out.scale_sigma * by_scale[k]).cwiseAbs2();
    result.sigma =
        (claimed + (point.check ? point.sigma : Eigen::Vector3d(Eigen::Vector3d::Zero())).cwiseAbs2())
            .cwiseSqrt();
    if (point.place) result.off = result.place - *point.place;
  }
  for (const ControlPoints::Bar& bar : control_.bars) {
    const auto placeOf = [&](std::uint32_t k) { return out.points[k].place; };
    out.bars.push_back({control_.points[bar.from].name, control_.points[bar.to].name, bar.check, bar.length,
                        bar.sigma, (placeOf(bar.to) - placeOf(bar.from)).norm() - bar.length});
  }
}

}  // namespace fathom::topside

#include "recon/slam/navigation_graph.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace fathom::slam {
namespace {

constexpr double kAnywhere = 1000;         // standard deviation of a place that nothing tells [m]
constexpr double kDepthReference_s = 600;  // a reference of depth serves so long: tides are slow
constexpr double kNanoseconds = 1e9;
constexpr int kBlocksPerPose = 8, kSpareBlocks = 40000;  // of the factor: a survey's fill is 3 to 5

double seconds(std::int64_t ns) {
  return static_cast<double>(ns) / kNanoseconds;
}

double headingOf(const SE3& T_odom_cam) {
  const Eigen::Vector3d ahead = T_odom_cam.rotation() * Eigen::Vector3d::UnitY();
  return std::atan2(ahead.y(), ahead.x());
}

int maxReferences(int keyframes) {
  return keyframes / 4 + 200;
}

IncrementalConfig solverConfig(const NavigationConfig& config) {
  config.validate();
  IncrementalConfig solver = config.solver;
  const int references = maxReferences(config.max_keyframes);
  solver.max_poses = 1 + config.max_keyframes + references;
  solver.max_measurements = 4 * config.max_keyframes + references + config.max_links + config.max_fixes + 1;
  solver.max_factor_blocks = std::int64_t{kBlocksPerPose} * solver.max_poses + kSpareBlocks;
  return solver;
}

}  // namespace

void NavigationConfig::validate() const {
  noise.validate();
  const bool counts =
      max_keyframes > 1 && max_links >= 0 && max_fixes >= 0 && lying_after > 0 && reweighted >= 0;
  const bool numbers = reference_s > 0 && reference_turn > 0 && jump_heading > 0 && gate > 0 &&
                       fix_gate > 0 && change_m > 0 && change_rad > 0;
  if (!counts || !numbers) throw std::invalid_argument("navigation graph: configuration out of range");
}

NavigationGraph::NavigationGraph(const NavigationConfig& config)
    : config_(config), solver_(solverConfig(config)), dvl_(config.noise), shift_sigma_(kAnywhere) {
  const IncrementalConfig sizes = solverConfig(config);
  frames_.reserve(at(config.max_keyframes));
  changed_.reserve(at(config.max_keyframes));
  frame_of_node_.reserve(at(sizes.max_poses));
  robust_.reserve(at(config.max_links + config.max_fixes));
  // The solver holds its first pose: nav's origin.
  (void)addNode(SE3());
}

std::size_t NavigationGraph::memoryBytes() const {
  return solver_.memoryBytes() + frames_.capacity() * sizeof(Frame) + robust_.capacity() * sizeof(Robust) +
         (changed_.capacity() + frame_of_node_.capacity()) * sizeof(int);
}

void NavigationGraph::setAnchor(const Eigen::Vector2d& shift, double sigma) {
  shift_ = shift;
  shift_sigma_ = sigma;
}

int NavigationGraph::addNode(const SE3& pose) {
  if (solver_.addPose(pose) != AddStatus::kOk) return -1;
  frame_of_node_.push_back(-1);
  return solver_.size() - 1;
}

int NavigationGraph::addFactor(const RelativePose& factor) {
  return solver_.addMeasurement(factor) == AddStatus::kOk ? solver_.measurements() - 1 : -1;
}

std::optional<int> NavigationGraph::addKeyframe(const KeyframeInput& input) {
  if (keyframes() == config_.max_keyframes) {
    ++counters_.keyframes_refused;
    return std::nullopt;
  }
  judge();
  Frame frame;
  frame.utc_ns = input.utc_ns;
  frame.T_odom_cam = input.T_odom_cam;
  frame.leapt = input.compass_jumped;
  frame.gyro_turn = input.gyro_turn;
  frame.ungyro_s = input.ungyro_s;
  const bool first = frames_.empty();
  StepQuality quality;
  SE3 reckoned;  // T_odom_cam with the way from the last keyframe corrected
  SE3 T_nav_cam(input.T_odom_cam.rotation(),
                input.T_odom_cam.translation() + Eigen::Vector3d(shift_.x(), shift_.y(), 0));
  if (!first) {
    const Frame& last = frames_.back();
    quality = {seconds(input.utc_ns - last.utc_ns), input.unlocked_s, input.untilted_s, dvl_.remainingShare(),
               config_.lever};
    frame.quality = quality;
    if (counters_.dvl_lies) quality.seconds_unlocked = quality.seconds;
    if (input.unlocked_s > 0) ++counters_.dvl_absent;
    reckoned = dvl_.corrected(last.T_odom_cam, input.T_odom_cam);
    T_nav_cam = solver_.pose(last.node) * (last.T_odom_cam.inverse() * reckoned);
  }
  frame.node = addNode(T_nav_cam);
  if (frame.node < 0) {
    ++counters_.keyframes_refused;
    return std::nullopt;
  }
  frame_of_node_.back() = keyframes();
  frame.known = T_nav_cam;
  if (first)
    (void)addFactor(fixFactor(kWorld, frame.node, T_nav_cam, input.T_odom_cam, input.T_odom_cam.translation(),
                              T_nav_cam.translation().head<2>(), shift_sigma_));
  else
    frame.step = addFactor(stepFactor(frames_.back().node, frame.node, frames_.back().T_odom_cam, reckoned,
                                      quality, config_.noise));
  jump_waits_ = jump_waits_ || input.compass_jumped;
  if (input.compass_jumped) ++counters_.compass_jumps;
  refer(input, frame);
  referDepth(input, frame.node);
  frames_.push_back(frame);
  seen_.waits = !first;
  ++counters_.keyframes;
  return keyframes() - 1;
}

// The factor of attitude, and a new reference when the present one has served.
void NavigationGraph::refer(const KeyframeInput& input, Frame& frame) {
  if (input.attitude_held) {
    ++counters_.attitude_absent;
    return;
  }
  const double heading = headingOf(input.T_odom_cam);
  const double age = attitude_.node < 0 ? 0 : seconds(input.utc_ns - attitude_.utc_ns);
  const double turn = attitude_.node < 0 ? 0 : std::abs(wrapAngle(heading - attitude_.heading));
  if (attitude_.node < 0 || age > config_.reference_s || turn > config_.reference_turn || jump_waits_) {
    const SE3 start = attitude_.node < 0 ? SE3() : solver_.pose(attitude_.node);
    const int reference = addNode(start);
    if (reference >= 0) {
      const double extra = jump_waits_ ? config_.jump_heading : 0;
      const int drift = addFactor(
          attitude_.node < 0 ? firstAttitudeReference(kWorld, reference, config_.noise)
                             : attitudeDrift(attitude_.node, reference, std::max(age, frame.quality.seconds),
                                             turn, extra, config_.noise));
      if (attitude_.node >= 0) frame.drift = drift;
      attitude_ = {reference, input.utc_ns, heading};
      jump_waits_ = false;
      ++counters_.references;
    }
  }
  if (attitude_.node < 0) return;
  frame.attitude = addFactor(attitudeFactor(attitude_.node, frame.node, input.T_odom_cam, config_.noise));
}

void NavigationGraph::referDepth(const KeyframeInput& input, int node) {
  if (input.depth_held) {
    ++counters_.depth_absent;
    return;
  }
  const SensorNoise& noise = config_.noise;
  if (noise.depth_offset > 0 || noise.depth_drift > 0) {
    const double age = depth_.node < 0 ? 0 : seconds(input.utc_ns - depth_.utc_ns);
    if (depth_.node < 0 || age > kDepthReference_s) {
      const int reference = addNode(depth_.node < 0 ? SE3() : solver_.pose(depth_.node));
      if (reference >= 0) {
        (void)addFactor(depth_.node < 0 ? firstDepthReference(kWorld, reference, noise)
                                        : depthDrift(depth_.node, reference, age, noise));
        depth_ = {reference, input.utc_ns, 0};
        ++counters_.references;
      }
    }
  }
  (void)addFactor(depthFactor(depth_.node < 0 ? kWorld : depth_.node, node, input.T_odom_cam, noise));
}

NavigationGraph::Prediction NavigationGraph::predict(int a, int b) {
  const int from = frames_[at(a)].node, to = frames_[at(b)].node;
  return {solver_.pose(from).inverse() * solver_.pose(to), solver_.relativeCovariance(from, to)};
}

SE3 NavigationGraph::T_nav_odom() const {
  if (frames_.empty()) return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(shift_.x(), shift_.y(), 0)};
  return solver_.pose(frames_.back().node) * frames_.back().T_odom_cam.inverse();
}

PoseGraph NavigationGraph::sensorGraph() const {
  PoseGraph graph;
  for (int node = 0; node < solver_.size(); ++node) {
    graph.ids.push_back(node);
    graph.poses.push_back(solver_.pose(node));
  }
  std::size_t robust = 0;  // robust_ is in the order of measurements
  for (int k = 0; k < solver_.measurements(); ++k) {
    if (robust < robust_.size() && robust_[robust].measurement == k) {
      ++robust;
      continue;
    }
    const Measurement& m = solver_.measurement(k);
    if (m.weight == 0) continue;
    graph.edges.push_back({std::max(m.from, 0), m.to, m.T_from_to, m.weight * m.root.transpose() * m.root});
  }
  return graph;
}

double NavigationGraph::deviation() const {
  return attitude_.node < 0 ? 0 : -solver_.pose(attitude_.node).euler().z();
}

}  // namespace fathom::slam

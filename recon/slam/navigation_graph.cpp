#include "recon/slam/navigation_graph.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "realtime/kernel/seconds.hpp"

namespace fathom::slam {
namespace {

constexpr double kAnywhere = 1000;  // standard deviation of a place that nothing tells [m]
// And what the factor has of it until something does: information that is 1e14 times the least in it would
// leave nothing of that when it is taken out.
constexpr double kGauge = 10;             // [m]
constexpr double kDepthReference_s = 40;  // a reference of depth serves so long: 17 mm of the fastest tide
constexpr int kBlocksPerPose = 14, kSpareBlocks = 40000;  // of the factor; ten hours of survey fill 80 %

using rt::seconds;

// What turning may take: a reference of attitude for every fourth keyframe, and so many more at once. Each
// has two measurements of its own.
constexpr int kKeyframesPerReference = 4, kSpareReferences = 200, kOfReference = 2;
int maxReferences(int keyframes) {
  return keyframes / kKeyframesPerReference + kSpareReferences;
}

IncrementalConfig solverConfig(const NavigationConfig& config) {
  config.validate();
  IncrementalConfig solver = config.solver;
  const int references = maxReferences(config.max_keyframes);
  constexpr int kOfUsbl = 2;  // its frame's prior and the anchor that it gives
  solver.max_poses = 2 + config.max_keyframes + references;
  solver.max_measurements = 4 * config.max_keyframes + kOfReference * references + config.max_links +
                            config.max_fixes + 1 + kOfUsbl;
  solver.max_factor_blocks = std::int64_t{kBlocksPerPose} * solver.max_poses + kSpareBlocks;
  return solver;
}

}  // namespace

NavigationGraph::NavigationGraph(const NavigationConfig& config)
    : config_(config),
      solver_(solverConfig(config)),
      dvl_(config.noise, config.dvl_in_camera, config.rig),
      shared_(solverConfig(config).max_poses),
      closures_(solverConfig(config).max_poses),
      frames_(at(config.max_keyframes)),
      reference_credit_(kKeyframesPerReference * kSpareReferences) {
  const IncrementalConfig sizes = solverConfig(config);
  changed_.reserve(at(config.max_keyframes));
  astray_.reserve(at(config.max_keyframes));
  frame_of_node_.resize(at(sizes.max_poses), -1);
  must_stay_.resize(at(sizes.max_poses), 1);
  robust_of_.resize(at(sizes.max_measurements), -1);
  references_.reserve(at(maxReferences(config.max_keyframes)));
  retired_.reserve(kRetiredAtOnce);
  robust_.reserve(at(config.max_links + config.max_fixes));
  // The solver holds its first pose: nav's origin.
  (void)addNode(SE3());
}

std::size_t NavigationGraph::memoryBytes() const {
  return solver_.memoryBytes() + shared_.memoryBytes() + closures_.memoryBytes() + frames_.memoryBytes() +
         robust_.capacity() * sizeof(Robust) + references_.capacity() * sizeof(Reference) +
         must_stay_.size() +
         (changed_.capacity() + astray_.capacity() + frame_of_node_.size() + robust_of_.size()) * sizeof(int);
}

Eigen::Vector2d NavigationGraph::startingShift() const {
  const double by_usbl = std::hypot(usbl_anchor_.sigma, usblShift(usbl_anchor_.sigma, config_.noise)),
               weight = 1 / (anchor_.sigma * anchor_.sigma), usbl_weight = 1 / (by_usbl * by_usbl);
  if (!(weight + usbl_weight > 0)) return Eigen::Vector2d::Zero();
  return (weight * anchor_.shift + usbl_weight * usbl_anchor_.shift) / (weight + usbl_weight);
}

// A pose for what all USBL positions share. It never retires.
void NavigationGraph::addUsbl(const Eigen::Vector2d& north_east, double sigma) {
  usbl_.sigma = usblShift(sigma, config_.noise);
  usbl_.T_nav_usbl = SE3(Eigen::Quaterniond::Identity(), {north_east.x(), north_east.y(), 0});
  usbl_.node = addNode(usbl_.T_nav_usbl);
  if (usbl_.node >= 0) (void)addFactor(usblFrame(kWorld, usbl_.node, usbl_.T_nav_usbl, sigma, config_.noise));
}

int NavigationGraph::addNode(const SE3& pose) {
  int node = -1;
  return solver_.addPose(pose, &node) == AddStatus::kOk ? node : -1;
}

int NavigationGraph::addFactor(const RelativePose& factor) {
  int measurement = -1;
  return solver_.addMeasurement(factor, &measurement) == AddStatus::kOk ? measurement : -1;
}

std::optional<int> NavigationGraph::addKeyframe(const KeyframeInput& input) {
  judge();
  makeRoom();
  if (frames_.full()) {
    ++counters_.keyframes_refused;
    return std::nullopt;
  }
  Frame frame;
  frame.utc_ns = input.utc_ns;
  frame.T_odom_cam = input.T_odom_cam;
  frame.leapt = input.compass_jumped;
  frame.gyro_turn = input.gyro_turn;
  frame.ungyro_s = input.ungyro_s;
  frame.range = input.range;
  dvl_.setSoundShare(input.sound_share);
  const bool first = frames_.empty();
  StepQuality quality;
  SE3 reckoned;  // T_odom_cam with the way from the last keyframe corrected
  const Eigen::Vector2d shift = startingShift();
  SE3 T_nav_cam(input.T_odom_cam.rotation(),
                input.T_odom_cam.translation() + Eigen::Vector3d(shift.x(), shift.y(), 0));
  if (!first) {
    const Frame& last = frames_.back();
    quality = {seconds(input.utc_ns - last.utc_ns),
               input.unlocked_s,
               input.untilted_s,
               dvl_.remainingShare(),
               last.T_odom_cam.rotation().angularDistance(input.T_odom_cam.rotation()),
               input.pressure_sigma};
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
  frame_of_node_[at(frame.node)] = keyframes();
  must_stay_[at(frame.node)] = 0;
  frame.known = T_nav_cam;
  if (first)
    addAnchors(frame, T_nav_cam);
  else
    frame.step = addFactor(stepFactor(frames_.back().node, frame.node, frames_.back().T_odom_cam, reckoned,
                                      config_.dvl_in_camera, quality, config_.noise));
  for (SharedByPose* errors : {&shared_, &closures_})
    errors->hang(frame.node, first ? 0 : frames_.back().node, T_nav_cam, SharedByPose::Each::Zero());
  reference_credit_ = std::min(reference_credit_ + 1, kKeyframesPerReference * kSpareReferences);
  jump_waits_ = jump_waits_ || input.compass_jumped;
  if (input.compass_jumped) ++counters_.compass_jumps;
  refer(input, frame);
  referDepth(input, frame.node);
  seen_.waits = !first;
  ++counters_.keyframes;
  return frames_.add(frame);
}

double NavigationGraph::anchorSigma() const {
  return std::min(anchor_.sigma, kAnywhere);
}

// Something tells where the first keyframe is.
void NavigationGraph::releaseGauge() {
  if (gauge_ < 0) return;
  (void)solver_.setWeight(gauge_, std::pow(kGauge / anchorSigma(), 2));
  must_stay_[at(solver_.measurement(gauge_).to)] = 0;
  gauge_ = -1;
}

// Where the first keyframe is.
void NavigationGraph::addAnchors(const Frame& frame, const SE3& T_nav_cam) {
  const Eigen::Vector3d& in_odom = frame.T_odom_cam.translation();
  const Eigen::Vector2d place = in_odom.head<2>();
  const bool unknown = anchor_.sigma > kGauge && !std::isfinite(usbl_anchor_.sigma);
  const int anchor = addFactor(fixFactor(kWorld, frame.node, T_nav_cam, frame.T_odom_cam, in_odom,
                                         place + anchor_.shift, unknown ? kGauge : anchorSigma()));
  if (unknown) gauge_ = anchor;
  must_stay_[at(frame.node)] = unknown ? 1 : 0;
  held_.add(T_nav_cam.translation().head<2>(), anchorSigma(), false);
  if (!std::isfinite(usbl_anchor_.sigma)) return;
  const Eigen::Vector2d seen = place + usbl_anchor_.shift;
  addUsbl(seen, usbl_anchor_.sigma);
  if (usbl_.node < 0) return;
  (void)addFactor(usblFixFactor(usbl_.node, frame.node, usbl_.T_nav_usbl, usbl_.T_nav_usbl, T_nav_cam,
                                frame.T_odom_cam, in_odom, seen, usbl_anchor_.sigma));
  held_.add(T_nav_cam.translation().head<2>(), usbl_anchor_.sigma, true);
}

// Counted against a credit that grows with the keyframes, so that turning for ever leaves room for them.
int NavigationGraph::newReference(const SE3& start) {
  if (reference_credit_ < kKeyframesPerReference || references_.size() == references_.capacity()) return -1;
  const int node = addNode(start);
  if (node < 0) return -1;
  reference_credit_ -= kKeyframesPerReference;
  ++counters_.references;
  return node;
}

// An earlier reference of attitude, still young, is of this heading: a vehicle that yaws to and fro comes
// back to it.
bool NavigationGraph::servesAgain(std::int64_t utc_ns, double heading) {
  if (jump_waits_) return false;
  double nearest = config_.reference_turn;
  const Reference* best = nullptr;
  for (std::size_t i = references_.size(); i-- > 0;) {
    const Reference& r = references_[i];
    if (r.utc_ns < jumped_ns_ || seconds(utc_ns - r.utc_ns) > config_.reference_s) break;
    const double turn = std::abs(wrapAngle(heading - r.heading));
    if (r.of_depth || turn > nearest) continue;
    nearest = turn;
    best = &r;
  }
  if (best != nullptr) attitude_ = *best;
  return best != nullptr;
}

// The factor of attitude, and a new reference when the present one has served.
void NavigationGraph::refer(const KeyframeInput& input, Frame& frame) {
  if (input.attitude_held) {
    ++counters_.attitude_absent;
    return;
  }
  const double heading = headingOf(input.T_odom_cam, config_.forward_in_camera);
  const double age = attitude_.node < 0 ? 0 : seconds(input.utc_ns - attitude_.utc_ns);
  const double turn = attitude_.node < 0 ? 0 : std::abs(wrapAngle(heading - attitude_.heading));
  const bool served =
      attitude_.node < 0 || age > config_.reference_s || turn > config_.reference_turn || jump_waits_;
  if (served && !servesAgain(input.utc_ns, heading)) {
    const SE3 start = attitude_.node < 0 ? SE3() : solver_.pose(attitude_.node);
    const int reference = newReference(start);
    if (reference >= 0) {
      const double extra = jump_waits_ ? config_.jump_heading : 0;
      const int drift = addFactor(
          attitude_.node < 0 ? firstAttitudeReference(kWorld, reference, config_.noise)
                             : attitudeDrift(attitude_.node, reference, std::max(age, frame.quality.seconds),
                                             turn, extra, config_.noise));
      if (attitude_.node >= 0) {
        frame.drift = drift;
        (void)addFactor(tiltAbout(kWorld, reference, turn, config_.noise));
      }
      if (jump_waits_) jumped_ns_ = input.utc_ns;
      attitude_ = {reference, input.utc_ns, heading, false};
      references_.push_back(attitude_);
      jump_waits_ = false;
    }
  }
  // After a jump nothing is known of the compass until it has a reference again.
  if (attitude_.node < 0 || jump_waits_) {
    ++counters_.attitude_absent;
    return;
  }
  SensorNoise noise = config_.noise;
  if (frame.quality.seconds > 0)
    noise.heading = std::hypot(noise.heading, noise.heading_lag * frame.quality.turn / frame.quality.seconds);
  const double beyond = std::abs(wrapAngle(heading - attitude_.heading));
  if (beyond > config_.reference_turn) {  // for want of a reference of its own
    noise.heading = std::hypot(noise.heading, noise.deviation_turn * std::sqrt(beyond));
    noise.tilt = std::hypot(noise.tilt, noise.tilt_turn * std::sqrt(beyond));
  }
  frame.attitude = addFactor(attitudeFactor(attitude_.node, frame.node, input.T_odom_cam, noise));
}

void NavigationGraph::referDepth(const KeyframeInput& input, int node) {
  if (input.depth_held) {
    ++counters_.depth_absent;
    return;
  }
  const SensorNoise& noise = config_.noise;
  const double age = tide_.node < 0 ? 0 : seconds(input.utc_ns - tide_.utc_ns);
  if (tide_.node < 0 || age > kDepthReference_s) {
    const SE3 start = tide_.node < 0 ? SE3() : solver_.pose(tide_.node);
    const int tide = newReference(start * tideStep(0, 1, age, noise).T_from_to);
    if (tide >= 0) {
      (void)addFactor(tide_.node < 0 ? firstTide(kWorld, tide, noise)
                                     : tideStep(tide_.node, tide, age, noise));
      tide_ = {tide, input.utc_ns, 0, true};
      references_.push_back(tide_);
    }
  }
  // Where there was no room for it with the tide, it comes as soon as there is.
  if (tide_.node >= 0 && (depth_.node < 0 || depth_.utc_ns < tide_.utc_ns)) {
    const SE3 T_nav_tide = solver_.pose(tide_.node);
    const int reference = newReference(SE3(Eigen::Quaterniond::Identity(), T_nav_tide.translation()));
    if (reference >= 0) {
      (void)addFactor(depthAtTide(tide_.node, reference));
      (void)addFactor(levelReference(kWorld, reference));
      depth_ = {reference, tide_.utc_ns, 0, true};
      references_.push_back(depth_);
    }
  }
  // By what is known of its rate the sea has risen since.
  const double risen =
      depth_.node < 0 ? 0 : tideRate(solver_.pose(tide_.node)) * seconds(input.utc_ns - depth_.utc_ns);
  const SE3 by_pressure(input.T_odom_cam.rotation(),
                        input.T_odom_cam.translation() + Eigen::Vector3d(0, 0, input.pressure_off + risen));
  (void)addFactor(depthFactor(depth_.node < 0 ? kWorld : depth_.node, node, by_pressure,
                              std::hypot(noise.depth, input.pressure_sigma)));
}

NavigationGraph::Prediction NavigationGraph::predict(int a, int b) {
  const int from = frames_[at(a)].node, to = frames_[at(b)].node;
  const SE3 &T_nav_a = solver_.pose(from), &T_nav_b = solver_.pose(to);
  return {T_nav_a.inverse() * T_nav_b,
          widened(relativeCovariance(from, to), T_nav_b,
                  sharedError((T_nav_b.translation() - T_nav_a.translation()).head<2>()))};
}

Matrix6d NavigationGraph::relativeCovariance(int from, int to) {
  return solver_.relativeCovariance(from, to) +
         shared_.covariance(from, to, solver_.pose(to), dvl_.curlCovariance());
}

Eigen::Matrix2d NavigationGraph::sharedError(const Eigen::Vector2d& from_held) const {
  const SensorNoise& noise = config_.noise;
  // While the DVL's scale is learnt anew, the images hold the survey.
  constexpr double kMostScale = 0.03;  // of a speed of sound that nobody measured [1]
  const Eigen::Vector2d most(kMostScale, noise.dvl_heading);
  const Eigen::Vector2d dvl = dvl_.covariance().diagonal().head<2>().cwiseMin(most.cwiseAbs2());
  return held_.errorOf(from_held, noise.visual_scale * noise.visual_scale + dvl(0), dvl(1), noise.usbl_turn);
}

Matrix6d NavigationGraph::widened(Matrix6d covariance, const SE3& T_nav_cam, const Eigen::Matrix2d& by) {
  const Eigen::Matrix<double, 2, 3> R = T_nav_cam.matrix3().topRows<2>();
  covariance.topLeftCorner<3, 3>() += R.transpose() * by * R;
  return covariance;
}

Matrix6d NavigationGraph::covariance(int keyframe) {
  const int node = frames_[at(keyframe)].node;
  const SE3& T_nav_cam = solver_.pose(node);
  Eigen::Matrix2d by = sharedError(T_nav_cam.translation().head<2>() - held_.middle(usbl_.sigma));
  if (gauge_ >= 0) by.diagonal().array() += std::pow(anchorSigma(), 2) - kGauge * kGauge;
  return widened(
      solver_.covariance(node) + shared_.covariance(kWorld, node, T_nav_cam, dvl_.curlCovariance()),
      T_nav_cam, by);
}

SE3 NavigationGraph::T_nav_odom() const {
  if (frames_.empty()) {
    const Eigen::Vector2d shift = startingShift();
    return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(shift.x(), shift.y(), 0)};
  }
  return solver_.pose(frames_.back().node) * frames_.back().T_odom_cam.inverse();
}

SE3 NavigationGraph::usblCorrection() const {
  if (usbl_.node < 0) return SE3();
  const SE3& now = solver_.pose(usbl_.node);
  return {now.rotation(), now.translation() - usbl_.T_nav_usbl.translation()};
}

PoseGraph NavigationGraph::sensorGraph() const {
  PoseGraph graph;
  for (int node = 0; node < solver_.size(); ++node) {
    graph.ids.push_back(node);
    graph.poses.push_back(solver_.pose(node));
  }
  for (int k = 0; k < solver_.measurements(); ++k) {
    const Measurement& m = solver_.measurement(k);
    const int keyframe = frame_of_node_[at(m.to)];
    const bool link = robust_of_[at(k)] >= 0 || (keyframe >= 0 && frames_[at(keyframe)].link == k);
    if (link || m.weight == 0) continue;
    graph.edges.push_back({std::max(m.from, 0), m.to, m.T_from_to, m.weight * m.root.transpose() * m.root});
  }
  return graph;
}

double NavigationGraph::deviation() const {
  return attitude_.node < 0 ? 0 : -solver_.pose(attitude_.node).euler().z();
}

double NavigationGraph::seaHeight() const {
  return depth_.node < 0 ? 0 : -solver_.pose(depth_.node).translation().z();
}

}  // namespace fathom::slam

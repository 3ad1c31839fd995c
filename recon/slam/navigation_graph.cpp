#include "recon/slam/navigation_graph.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace fathom::slam {
namespace {

constexpr double kAnywhere = 1000;   // standard deviation of a place that nothing tells [m]
constexpr double kOffAt = 2;         // times what chance explains: a factor is switched off
constexpr double kSettled = 0.01;    // share of chi2 that poses at rest may still lose
constexpr double kNewWeight = 0.15;  // relative change of a weight that is worth the solver's work
constexpr double kTurnedSigmas = 4;  // by which a compass differs from the camera that it has jumped
// Of the graph's own covariance where a closure is judged by it: links share errors that it takes for
// independent, and after a long way its standard deviations are half of what they should be.
constexpr double kKnownScale = 4;
constexpr double kAlike = 3;               // standard deviations between two wild fixes that agree
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
  solver.max_measurements = 3 * config.max_keyframes + references + config.max_links + config.max_fixes + 1;
  solver.max_factor_blocks = std::int64_t{kBlocksPerPose} * solver.max_poses + kSpareBlocks;
  return solver;
}

// Error of a factor as a right perturbation (rho, phi).
Vector6d perturbationOf(const RelativePose& factor, const SE3& T_from, const SE3& T_to) {
  Vector6d e = relativePoseError(factor, T_from, T_to);
  e.tail<3>() *= 2;
  return e;
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
  Frame frame;
  frame.utc_ns = input.utc_ns;
  frame.T_odom_cam = input.T_odom_cam;
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
  frame.attitude = refer(input, frame.node, frame.quality.seconds);
  referDepth(input, frame.node);
  frames_.push_back(frame);
  ++counters_.keyframes;
  return keyframes() - 1;
}

// The factor of attitude, and a new reference when the present one has served.
int NavigationGraph::refer(const KeyframeInput& input, int node, double since_last) {
  if (input.attitude_held) {
    ++counters_.attitude_absent;
    return -1;
  }
  const double heading = headingOf(input.T_odom_cam);
  const double age = attitude_.node < 0 ? 0 : seconds(input.utc_ns - attitude_.utc_ns);
  const double turn = attitude_.node < 0 ? 0 : std::abs(wrapAngle(heading - attitude_.heading));
  if (attitude_.node < 0 || age > config_.reference_s || turn > config_.reference_turn || jump_waits_) {
    const SE3 start = attitude_.node < 0 ? SE3() : solver_.pose(attitude_.node);
    const int reference = addNode(start);
    if (reference >= 0) {
      const double extra = jump_waits_ ? config_.jump_heading : 0;
      (void)addFactor(attitude_.node < 0 ? firstAttitudeReference(kWorld, reference, config_.noise)
                                         : attitudeDrift(attitude_.node, reference, std::max(age, since_last),
                                                         turn, extra, config_.noise));
      attitude_ = {reference, input.utc_ns, heading};
      jump_waits_ = false;
      ++counters_.references;
    }
  }
  if (attitude_.node < 0) return -1;
  return addFactor(attitudeFactor(attitude_.node, node, input.T_odom_cam, config_.noise));
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

double NavigationGraph::distance2(const RelativePose& factor, const Matrix6d& covariance) const {
  const Vector6d e = perturbationOf(factor, solver_.pose(factor.from), solver_.pose(factor.to));
  return e.dot(covariance.ldlt().solve(e));
}

// Visual odometry against dead reckoning's step: its own noise, with the compass's and depth sensor's of both
// ends. A camera that looks down has heading about its z axis.
void NavigationGraph::compareStep(Frame& from, Frame& to, const SE3& T_a_b, const Matrix6d& covariance) {
  const SensorNoise& noise = config_.noise;
  const SE3 T_odom_to = dvl_.corrected(from.T_odom_cam, to.T_odom_cam);
  const double place = stepSigma(T_a_b.translation().norm(), to.quality, noise);
  const double turn = std::abs(2 * T_a_b.rotation().vec().norm());
  Vector6d sigma;
  sigma << place, place, std::hypot(place, 2 * noise.depth), 2 * noise.tilt, 2 * noise.tilt,
      std::hypot(2 * noise.heading, noise.deviation_turn * std::sqrt(turn));
  const Matrix6d step = sigma.cwiseAbs2().asDiagonal();
  const Vector6d e = perturbationOf({0, 1, T_a_b, Matrix6d::Identity()}, from.T_odom_cam, T_odom_to);
  if (e.dot((step + covariance).ldlt().solve(e)) <= config_.gate) {
    contradictions_ = 0;
    if (++agreements_ >= config_.lying_after) counters_.dvl_lies = false;
    if (to.quality.seconds_unlocked == 0)
      (void)dvl_.add(from.T_odom_cam, to.T_odom_cam, T_a_b, covariance, to.quality);
    return;
  }
  ++counters_.steps_contradicted;
  if (to.step >= 0 && solver_.setWeight(to.step, 0)) ++counters_.steps_left_out;
  // A turn that the camera did not see is the compass's: what it says from here on has another reference.
  if (std::abs(e(5)) > kTurnedSigmas * sigma(5)) {
    if (to.attitude >= 0) (void)solver_.setWeight(to.attitude, 0);
    jump_waits_ = true;
    ++counters_.compass_jumps;
    return;
  }
  agreements_ = 0;
  if (++contradictions_ >= config_.lying_after) counters_.dvl_lies = true;
}

Taken NavigationGraph::addLink(LinkKind kind, int a, int b, const SE3& T_a_b, const Matrix6d& covariance) {
  if (a < 0 || b < 0 || a >= keyframes() || b >= keyframes() || a == b || !covariance.allFinite()) {
    ++counters_.links_refused;
    return Taken::kBad;
  }
  Frame& to = frames_[at(b)];
  const Frame& from = frames_[at(a)];
  const RelativePose factor = linkFactor(from.node, to.node, T_a_b, covariance);
  if (robust_.size() == robust_.capacity() || !factor.information.allFinite()) {
    ++counters_.links_refused;
    return Taken::kFull;
  }
  if (kind == LinkKind::kOdometry && b == a + 1 && to.step >= 0) {
    compareStep(frames_[at(a)], to, T_a_b, covariance);
  } else if (kind != LinkKind::kAgreed) {
    const Prediction known = predict(a, b);
    const bool fits = distance2(factor, kKnownScale * known.covariance + covariance) <= config_.gate;
    closures_refused_ = fits ? 0 : closures_refused_ + 1;
    if (!fits) ++counters_.links_contradicting;
    // Where closures are contradicted one after the other, an earlier one is wrong: the weights decide.
    if (!fits && closures_refused_ < config_.lying_after) return Taken::kContradicts;
  }
  const int measurement = addFactor(factor);
  if (measurement < 0) {
    ++counters_.links_refused;
    return Taken::kFull;
  }
  // What others agree with is believed however far the poses still have to go.
  const double free = kind == LinkKind::kAgreed ? std::numeric_limits<double>::max() / kOffAt : kLinkFree;
  robust_.push_back({factor, covariance, measurement, free, 1, false, false});
  ++(kind == LinkKind::kOdometry ? counters_.odometry_links : counters_.closures);
  return Taken::kYes;
}

Taken NavigationGraph::addFix(int keyframe, const Eigen::Vector3d& antenna_in_odom,
                              const Eigen::Vector2d& north_east, double sigma) {
  if (keyframe < 0 || keyframe >= keyframes() || !antenna_in_odom.allFinite() || !north_east.allFinite() ||
      !(sigma > 0) || !std::isfinite(sigma)) {
    ++counters_.fixes_refused;
    return Taken::kBad;
  }
  const Frame& frame = frames_[at(keyframe)];
  if (robust_.size() == robust_.capacity()) {
    ++counters_.fixes_refused;
    return Taken::kFull;
  }
  const SE3& T_nav_cam = solver_.pose(frame.node);
  const RelativePose factor =
      fixFactor(kWorld, frame.node, T_nav_cam, frame.T_odom_cam, antenna_in_odom, north_east, sigma);
  const Eigen::Matrix3d R = T_nav_cam.matrix3();
  const Eigen::Matrix2d spread =
      (R * solver_.covariance(frame.node).topLeftCorner<3, 3>() * R.transpose()).topLeftCorner<2, 2>() +
      sigma * sigma * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d innovation = (factor.T_from_to.translation() - T_nav_cam.translation()).head<2>();
  if (innovation.dot(spread.inverse() * innovation) > config_.fix_gate) {
    // Wild fixes differ from each other; fixes that agree that the vehicle is elsewhere are believed.
    const bool alike = fixes_alike_ > 0 && (innovation - gated_innovation_).norm() < kAlike * sigma;
    fixes_alike_ = alike ? fixes_alike_ + 1 : 1;
    gated_innovation_ = innovation;
    ++counters_.fixes_gated;
    if (fixes_alike_ < config_.lying_after) return Taken::kContradicts;
  }
  const int measurement = addFactor(factor);
  if (measurement < 0) {
    ++counters_.fixes_refused;
    return Taken::kFull;
  }
  robust_.push_back({factor, Matrix6d::Zero(), measurement, kFixFree, 1, true, false});
  ++counters_.fixes;
  return Taken::kYes;
}

// Robust weights of the newest factors and of some older ones in turn. A factor is switched off only by poses
// that have come to rest, and on again when it is as likely as a new one must be.
void NavigationGraph::reweight(bool settled) {
  if (robust_.empty()) return;
  const auto look = [&](Robust& r) {
    const SE3 from = r.factor.from == kWorld ? SE3() : solver_.pose(r.factor.from);
    const Vector6d e = relativePoseError(r.factor, from, solver_.pose(r.factor.to));
    const double chi2 = e.dot(r.factor.information * e);
    const bool off = r.off ? !(fits(r) && settled) : settled && !(chi2 <= kOffAt * r.free_chi2);
    std::uint64_t& offs = r.fix ? counters_.fixes_off : counters_.links_off;
    if (off && !r.off) ++offs;
    if (!off && r.off) --offs;
    const double wanted = off ? 0 : cauchyWeight(chi2, r.free_chi2);
    if (off != r.off || std::abs(wanted - r.weight) > kNewWeight * r.weight) {
      (void)solver_.setWeight(r.measurement, wanted);
      r.weight = wanted;
    }
    r.off = off;
  };
  int left = config_.reweighted;
  for (; newest_robust_ < robust_.size() && left > 0; ++newest_robust_, --left) look(robust_[newest_robust_]);
  for (; left > 0; --left) {
    look(robust_[next_robust_]);
    next_robust_ = (next_robust_ + 1) % robust_.size();
  }
}

// Whether a factor that is switched off agrees with what the rest says.
bool NavigationGraph::fits(const Robust& r) {
  if (r.fix) {
    const SE3& pose = solver_.pose(r.factor.to);
    const Vector6d e = relativePoseError(r.factor, SE3(), pose);
    return e.dot(r.factor.information * e) <= r.free_chi2;
  }
  const Matrix6d known = solver_.relativeCovariance(r.factor.from, r.factor.to);
  return distance2(r.factor, kKnownScale * known + r.covariance) <= config_.gate;
}

StepReport NavigationGraph::step() {
  const StepReport report = solver_.step();
  reweight(report.decrease_expected <= kSettled * (1 + report.chi2) && !report.waits_for_factor);
  noteChanges();
  return report;
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

#include "recon/navigation/graph/sensor_references.hpp"

#include <cmath>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom::slam {
namespace {

constexpr double kDepthReference_s = 40;  // a reference of depth serves so long: 17 mm of the fastest tide
constexpr int kMostCredit = KeyframeStore::kKeyframesPerReference * KeyframeStore::kSpareReferences;
constexpr int kLookedAt = 64;  // references, by one leastNeeded()

using rt::seconds;

}  // namespace

SensorReferences::SensorReferences(KeyframeStore& keyframes)
    : keyframes_(keyframes), config_(keyframes.config()), credit_(kMostCredit) {
  references_.reserve(static_cast<std::size_t>(KeyframeStore::maxReferences(config_.max_keyframes)));
}

void SensorReferences::addKeyframe(const KeyframeInput& input, Keyframe& keyframe) {
  credit_ = std::min(credit_ + 1, kMostCredit);
  jump_waits_ = jump_waits_ || input.compass_jumped;
  if (input.compass_jumped) ++keyframes_.counters().compass_jumps;
  addAttitude(input, keyframe);
  addDepth(input, keyframe.node);
}

int SensorReferences::newReference(const SE3& start) {
  if (credit_ < KeyframeStore::kKeyframesPerReference || references_.size() == references_.capacity())
    return -1;
  const int node = keyframes_.addNode(start);
  if (node < 0) return -1;
  credit_ -= KeyframeStore::kKeyframesPerReference;
  ++keyframes_.counters().references;
  return node;
}

// Takes up a young reference of attitude of this heading, where there is one: a vehicle that yaws to and fro
// comes back to it.
bool SensorReferences::reuseReference(std::int64_t utc_ns, double heading) {
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

// `age` and `turn`: since the present reference began [s], [rad].
void SensorReferences::beginAttitude(const KeyframeInput& input, Keyframe& keyframe, double heading,
                                     double age, double turn) {
  const bool first = attitude_.node < 0;
  const SE3 start = first ? firstAttitudeReference(kWorld, 0, input.compass_off, config_.noise).T_from_to
                          : keyframes_.solver().pose(attitude_.node);
  const int reference = newReference(start);
  if (reference < 0) return;
  const double extra = jump_waits_ ? config_.jump_heading : 0;
  const int drift = keyframes_.addFactor(
      first ? firstAttitudeReference(kWorld, reference, input.compass_off, config_.noise)
            : attitudeDrift(attitude_.node, reference, std::max(age, keyframe.quality.seconds), turn, extra,
                            config_.noise));
  if (!first) {
    keyframe.drift = drift;
    (void)keyframes_.addFactor(tiltAbout(kWorld, reference, turn, config_.noise));
  }
  if (jump_waits_) jumped_ns_ = input.utc_ns;
  attitude_ = {reference, input.utc_ns, heading, false};
  references_.push_back(attitude_);
  jump_waits_ = false;
}

void SensorReferences::addAttitude(const KeyframeInput& input, Keyframe& keyframe) {
  if (input.attitude_held) {
    ++keyframes_.counters().attitude_absent;
    return;
  }
  const double heading = headingOf(input.T_odom_cam, config_.forward_in_camera);
  const double age = attitude_.node < 0 ? 0 : seconds(input.utc_ns - attitude_.utc_ns);
  const double turn = attitude_.node < 0 ? 0 : std::abs(wrapAngle(heading - attitude_.heading));
  const bool served =
      attitude_.node < 0 || age > config_.reference_s || turn > config_.reference_turn || jump_waits_;
  if (served && !reuseReference(input.utc_ns, heading)) beginAttitude(input, keyframe, heading, age, turn);
  // After a jump nothing is known of the compass until it has a reference again.
  if (attitude_.node < 0 || jump_waits_) {
    ++keyframes_.counters().attitude_absent;
    return;
  }
  SensorNoise noise = config_.noise;
  if (keyframe.quality.seconds > 0)
    noise.heading =
        hypotenuse(noise.heading, noise.heading_lag * keyframe.quality.turn / keyframe.quality.seconds);
  const double beyond = std::abs(wrapAngle(heading - attitude_.heading));
  if (beyond > config_.reference_turn) {  // there was no room for a reference of this heading
    noise.heading = hypotenuse(noise.heading, noise.deviation_turn * std::sqrt(beyond));
    noise.tilt = hypotenuse(noise.tilt, noise.tilt_turn * std::sqrt(beyond));
  }
  keyframe.attitude =
      keyframes_.addFactor(attitudeFactor(attitude_.node, keyframe.node, input.T_odom_cam, noise));
}

// The next pose of the tide, and the reference of depth level at it.
void SensorReferences::beginDepth(std::int64_t utc_ns) {
  const SensorNoise& noise = config_.noise;
  const double age = tide_.node < 0 ? 0 : seconds(utc_ns - tide_.utc_ns);
  if (tide_.node < 0 || age > kDepthReference_s) {
    const SE3 start = tide_.node < 0 ? SE3() : keyframes_.solver().pose(tide_.node);
    const int tide = newReference(start * tideStep(0, 1, age, noise).T_from_to);
    if (tide >= 0) {
      (void)keyframes_.addFactor(tide_.node < 0 ? firstTide(kWorld, tide, noise)
                                                : tideStep(tide_.node, tide, age, noise));
      tide_ = {tide, utc_ns, 0, true};
      references_.push_back(tide_);
    }
  }
  // Where there was no room for it with the tide, it comes as soon as there is.
  if (tide_.node < 0 || (depth_.node >= 0 && depth_.utc_ns >= tide_.utc_ns)) return;
  const SE3 T_nav_tide = keyframes_.solver().pose(tide_.node);
  const int reference = newReference(SE3(Eigen::Quaterniond::Identity(), T_nav_tide.translation()));
  if (reference < 0) return;
  (void)keyframes_.addFactor(depthAtTide(tide_.node, reference));
  (void)keyframes_.addFactor(levelReference(kWorld, reference));
  depth_ = {reference, tide_.utc_ns, 0, true};
  references_.push_back(depth_);
}

void SensorReferences::addDepth(const KeyframeInput& input, int node) {
  if (input.depth_held) {
    ++keyframes_.counters().depth_absent;
    return;
  }
  beginDepth(input.utc_ns);
  // By what is known of its rate the sea has risen since.
  const double risen = depth_.node < 0 ? 0
                                       : tideRate(keyframes_.solver().pose(tide_.node)) *
                                             seconds(input.utc_ns - depth_.utc_ns);
  const SE3 by_pressure(input.T_odom_cam.rotation(),
                        input.T_odom_cam.translation() + Eigen::Vector3d(0, 0, input.pressure_off + risen));
  (void)keyframes_.addFactor(depthFactor(depth_.node < 0 ? kWorld : depth_.node, node, by_pressure,
                                         hypotenuse(config_.noise.depth, input.pressure_sigma)));
}

void SensorReferences::appendAttitudeNodes(std::int64_t since_ns, std::vector<int>& nodes) const {
  for (const Reference& r : references_)
    if (!r.of_depth && r.utc_ns >= since_ns) nodes.push_back(r.node);
}

bool SensorReferences::isShort(std::size_t spare) const {
  return references_.size() + std::min(spare, references_.capacity() / 8) >= references_.capacity();
}

std::optional<std::size_t> SensorReferences::leastNeeded(std::size_t most_named) {
  const IncrementalSolver& solver = keyframes_.solver();
  const auto isYoung = [&](const Reference& r) {
    return static_cast<double>(references_.back().utc_ns - r.utc_ns) <=
           config_.reference_s * kNanosecondsPerSecond;
  };
  std::optional<std::size_t> best;
  std::size_t fewest = most_named + 1;
  for (int looked = 0; looked < std::min(kLookedAt, static_cast<int>(references_.size())); ++looked) {
    next_ = (next_ + 1) % references_.size();
    const Reference& r = references_[next_];
    if (r.node == attitude_.node || r.node == depth_.node || r.node == tide_.node || isYoung(r)) continue;
    std::size_t named = 0;
    for (int k = solver.firstMeasurement(r.node); k >= 0 && named < fewest;
         k = solver.nextMeasurement(k, r.node))
      ++named;
    if (named >= fewest) continue;
    fewest = named;
    best = next_;
  }
  return best;
}

void SensorReferences::erase(std::size_t position) {
  references_.erase(references_.begin() + static_cast<std::ptrdiff_t>(position));
  ++keyframes_.counters().references_retired;
}

bool SensorReferences::has(int node) const {
  return std::any_of(references_.begin(), references_.end(),
                     [&](const Reference& r) { return r.node == node; });
}

bool SensorReferences::isConsistent() const {
  const auto isReference = [&](const Reference& r) {
    return r.node > 0 && keyframes_.isNode(r.node) && keyframes_.ofNode(r.node) < 0;
  };
  std::vector<int> nodes;
  for (const Reference& r : references_) nodes.push_back(r.node);
  std::sort(nodes.begin(), nodes.end());
  if (std::adjacent_find(nodes.begin(), nodes.end()) != nodes.end()) return false;
  const auto isPresent = [&](const Reference& r) { return r.node == -1 || isReference(r); };
  return std::all_of(references_.begin(), references_.end(), isReference) && isPresent(attitude_) &&
         isPresent(depth_) && isPresent(tide_) && next_ <= references_.size() && credit_ >= 0;
}

}  // namespace fathom::slam

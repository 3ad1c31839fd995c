#include "recon/navigation/graph/keyframe_retirement.hpp"

#include <algorithm>
#include <array>

#include "recon/solver/incremental/retirement.hpp"

namespace fathom::slam {
namespace {

constexpr std::size_t kRetiredAtOnce = 2;  // keyframes for one that comes
// So much is kept free of each pool, an eighth of it at most: a pose whose measurements have not settled must
// wait, and then a later keyframe makes the room.
constexpr std::size_t kSpare = 32;
// Poses that fixes and links still come for, and those whose sensors are still being judged.
constexpr int kNewestKept = HeadingGate::kWindow, kLeastKept = 4;
constexpr std::size_t kMostNamed = 2 * kMostLinks;

}  // namespace

KeyframeRetirement::KeyframeRetirement(KeyframeStore& keyframes, RobustFactors& robust,
                                       SensorReferences& references)
    : keyframes_(keyframes), robust_(robust), references_(references) {
  retired_.reserve(kRetiredAtOnce);
}

void KeyframeRetirement::makeRoom() {
  retired_.clear();
  while (retired_.size() < kRetiredAtOnce && (keyframes_.isShort(kSpare) || robust_.isShort(kSpare)))
    if (!retireKeyframe()) break;
  if (references_.isShort(kSpare)) retireReference();
}

bool KeyframeRetirement::retireKeyframe() {
  IncrementalSolver& solver = keyframes_.solver();
  const int kept = std::clamp(keyframes_.config().max_keyframes / 4, kLeastKept, kNewestKept);
  const int node = solver.leastNeeded(kept, keyframes_.mustStay());
  if (node < 0) return false;
  const int number = keyframes_.ofNode(node);
  const SE3 pose = solver.pose(node);
  if (!retireNode(node)) return false;
  const Keyframe gone = keyframes_[number];
  keyframes_.erase(number);
  const int onto = keyframes_.nearestInTime(number, gone.utc_ns);
  const Keyframe& to = keyframes_[onto];
  retired_.push_back(
      {number, onto, to.T_odom_cam * solver.pose(to.node).inverse() * pose * gone.T_odom_cam.inverse()});
  ++keyframes_.counters().keyframes_retired;
  return true;
}

void KeyframeRetirement::retireReference() {
  const auto position = references_.leastNeeded(kMostNamed);
  if (position && retireNode(references_.node(*position))) references_.erase(*position);
}

bool KeyframeRetirement::retireNode(int node) {
  IncrementalSolver& solver = keyframes_.solver();
  struct Named {
    int measurement, other_end;
  };
  std::array<Named, kMostNamed> named;
  std::size_t count = 0;
  for (int k = solver.firstMeasurement(node); k >= 0; k = solver.nextMeasurement(k, node)) {
    if (count == named.size()) return false;
    const Measurement& m = solver.measurement(k);
    named[count++] = {k, m.from == node ? m.to : m.from};
  }
  if (solver.retire(node) != RetireStatus::kOk) return false;
  for (std::size_t i = 0; i < count; ++i) forget(named[i].measurement, named[i].other_end);
  return true;
}

// A measurement that went with a pose: its index is another's from now on.
void KeyframeRetirement::forget(int measurement, int other_end) {
  const int number = other_end < 0 ? -1 : keyframes_.ofNode(other_end);
  if (number >= 0) {
    Keyframe& k = keyframes_[number];
    for (int* factor : {&k.step, &k.attitude, &k.link})
      if (*factor == measurement) *factor = -1;
  }
  const std::span<const int> all = keyframes_.living();
  for (const int newest : all.last(std::min<std::size_t>(all.size(), HeadingGate::kWindow)))
    if (keyframes_[newest].drift == measurement) keyframes_[newest].drift = -1;
  robust_.forget(measurement);
}

}  // namespace fathom::slam

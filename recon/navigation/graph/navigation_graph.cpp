#include "recon/navigation/graph/navigation_graph.hpp"

#include <algorithm>
#include <array>

#include "realtime/base/units.hpp"
#include "recon/geometry/state_values.hpp"
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

constexpr std::uint32_t kGraphTag = rt::stateTag("GRPH"), kGraphVersion = 14;
// A graph is at rest when chi2 may still fall by less than this share of it.
constexpr double kAtRest = 0.01;

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
  for (std::size_t i = 0; i < count; ++i) removeMeasurement(named[i].measurement, named[i].other_end);
  return true;
}

// A measurement that went with a pose: its index is another's from now on.
void KeyframeRetirement::removeMeasurement(int measurement, int other_end) {
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

NavigationGraph::NavigationGraph(const NavigationConfig& config)
    : keyframes_(config),
      dvl_(config.noise, config.dvl_in_camera, config.rig),
      robust_(keyframes_),
      turns_(keyframes_, dvl_, robust_),
      references_(keyframes_),
      steps_(keyframes_, dvl_, references_),
      fixes_(keyframes_, dvl_, turns_, robust_),
      links_(keyframes_, dvl_, turns_, robust_, fixes_, steps_, references_),
      retirement_(keyframes_, robust_, references_) {}

std::size_t NavigationGraph::memoryBytes() const {
  return keyframes_.memoryBytes() + turns_.memoryBytes() + robust_.memoryBytes() + references_.memoryBytes() +
         links_.memoryBytes();
}

// A keyframe as it comes, with the quality of the step to it.
Keyframe NavigationGraph::begin(const KeyframeInput& input) const {
  Keyframe keyframe;
  keyframe.utc_ns = input.utc_ns;
  keyframe.T_odom_cam = input.T_odom_cam;
  keyframe.compass_jumped = input.compass_jumped;
  keyframe.gyro_turn = input.gyro_turn;
  keyframe.ungyro_s = input.ungyro_s;
  keyframe.range = input.range;
  if (keyframes_.living().empty()) return keyframe;
  const Keyframe& last = keyframes_.back();
  keyframe.quality = {rt::seconds(input.utc_ns - last.utc_ns),
                      input.unlocked_s,
                      input.untilted_s,
                      dvl_.remainingShare(),
                      last.T_odom_cam.rotation().angularDistance(input.T_odom_cam.rotation()),
                      input.pressure_sigma};
  return keyframe;
}

std::optional<int> NavigationGraph::addKeyframe(const KeyframeInput& input) {
  judge();
  retirement_.makeRoom();
  Counters& counters = keyframes_.counters();
  if (keyframes_.isFull()) {
    ++counters.keyframes_refused;
    return std::nullopt;
  }
  dvl_.setSoundShare(input.sound_share);
  const bool first = keyframes_.living().empty();
  Keyframe keyframe = begin(input);
  StepQuality quality = keyframe.quality;
  SE3 reckoned;  // T_odom_cam with the path from the last keyframe corrected
  const Eigen::Vector2d shift = fixes_.startingShift();
  SE3 T_nav_cam(input.T_odom_cam.rotation(),
                input.T_odom_cam.translation() + Eigen::Vector3d(shift.x(), shift.y(), 0));
  if (!first) {
    const Keyframe& last = keyframes_.back();
    if (counters.dvl_rejected) quality.seconds_unlocked = quality.seconds;
    if (input.unlocked_s > 0) ++counters.dvl_absent;
    reckoned = dvl_.corrected(last.T_odom_cam, input.T_odom_cam);
    T_nav_cam = keyframes_.solver().pose(last.node) * (last.T_odom_cam.inverse() * reckoned);
  }
  keyframe.node = keyframes_.addKeyframeNode(T_nav_cam);
  if (keyframe.node < 0) {
    ++counters.keyframes_refused;
    return std::nullopt;
  }
  keyframe.known = T_nav_cam;
  if (first)
    fixes_.anchorFirst(keyframe, T_nav_cam);
  else
    keyframe.step = keyframes_.addFactor(
        stepFactor(keyframes_.back().node, keyframe.node, keyframes_.back().T_odom_cam, reckoned,
                   keyframes_.config().dvl_in_camera, quality, keyframes_.config().noise));
  turns_.hangKeyframe(keyframe.node, first ? 0 : keyframes_.back().node, T_nav_cam);
  references_.addKeyframe(input, keyframe);
  if (!first) steps_.beginStep();
  ++counters.keyframes;
  return keyframes_.add(keyframe);
}

void NavigationGraph::resetRig(double turn_sigma, std::int64_t since_ns, bool knocked) {
  judge();
  turns_.resetRig(turn_sigma);
  steps_.resetRig(since_ns, knocked);
}

StepReport NavigationGraph::step() {
  judge();
  const StepReport report = keyframes_.solver().step();
  turns_.follow();
  robust_.reweight(report.decrease_expected <= kAtRest * (1 + report.chi2) && !report.waits_for_factor,
                   turns_);
  keyframes_.noteChanges();
  return report;
}

SE3 NavigationGraph::T_nav_odom() const {
  if (keyframes_.living().empty()) {
    const Eigen::Vector2d shift = fixes_.startingShift();
    return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(shift.x(), shift.y(), 0)};
  }
  return solver().pose(keyframes_.back().node) * keyframes_.back().T_odom_cam.inverse();
}

double NavigationGraph::visualWeight(int keyframe) const {
  const int link = keyframes_[keyframe].link;
  return link < 0 ? 0 : solver().measurement(link).weight;
}

PoseGraph NavigationGraph::sensorGraph() const {
  PoseGraph graph;
  for (int node = 0; node < solver().size(); ++node) {
    graph.ids.push_back(node);
    graph.poses.push_back(solver().pose(node));
  }
  for (int k = 0; k < solver().measurements(); ++k) {
    const Measurement& m = solver().measurement(k);
    const int keyframe = keyframes_.ofNode(m.to);
    const bool link = robust_.has(k) || (keyframe >= 0 && keyframes_[keyframe].link == k);
    if (link || m.weight == 0) continue;
    graph.edges.push_back({std::max(m.from, 0), m.to, m.T_from_to, m.weight * m.root.transpose() * m.root});
  }
  return graph;
}

void NavigationGraph::exchange(auto& archive, auto& self) {
  archive(self.keyframes_.solver(), self.dvl_);
  KeyframeStore::exchangeChanges(archive, self.keyframes_);
  RobustFactors::exchangeTurn(archive, self.robust_);
  FixGate::exchangeAnchors(archive, self.fixes_);
  SensorReferences::exchangeJump(archive, self.references_);
  archive(self.steps_, self.turns_, self.fixes_, self.links_, self.references_);
  KeyframeStore::exchangeKeyframes(archive, self.keyframes_);
  archive(self.robust_);
}

void NavigationGraph::save(rt::StateWriter& writer) const {
  writer.section(kGraphTag, kGraphVersion, [&] { exchange(writer, *this); });
}

bool NavigationGraph::load(rt::StateReader& reader) {
  return reader.section(kGraphTag, kGraphVersion, [&] {
    exchange(reader, *this);
    if (reader.ok() && !rebuildIndices()) reader.fail("the navigation graph contradicts itself");
    if (reader.ok()) turns_.restart();
  });
}

bool NavigationGraph::rebuildIndices() {
  retirement_.clear();
  return keyframes_.rebuildIndices() && (!steps_.waits() || has(keyframes() - 2)) &&
         fixes_.rebuildIndices() && robust_.rebuildIndices() && references_.isConsistent() &&
         !references_.has(fixes_.usblNode());
}

}  // namespace fathom::slam

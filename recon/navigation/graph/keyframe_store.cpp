#include "recon/navigation/graph/keyframe_store.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <limits>

#include "realtime/base/bytes/state_archive.hpp"

namespace fathom::slam {
namespace {

constexpr int kBlocksPerPose = 14, kSpareBlocks = 40000;  // of the factor; ten hours of survey fill 80 %
constexpr int kFactorsPerReference = 2;

IncrementalConfig solverConfig(const NavigationConfig& config) {
  config.validate();
  IncrementalConfig solver = config.solver;
  const int references = KeyframeStore::maxReferences(config.max_keyframes);
  constexpr int kOfUsbl = 2;  // the prior of its frame, and the anchor that it gives
  solver.max_poses = 2 + config.max_keyframes + references;
  solver.max_measurements = 4 * config.max_keyframes + kFactorsPerReference * references + config.max_links +
                            config.max_fixes + 1 + kOfUsbl;
  solver.max_factor_blocks = std::int64_t{kBlocksPerPose} * solver.max_poses + kSpareBlocks;
  return solver;
}

}  // namespace

KeyframeStore::KeyframeStore(const NavigationConfig& config)
    : config_(config), solver_(solverConfig(config)), keyframes_(at(config.max_keyframes)) {
  config_.solver = solverConfig(config);
  changed_.reserve(at(config.max_keyframes));
  keyframe_of_node_.resize(at(config_.solver.max_poses), -1);
  must_stay_.resize(at(config_.solver.max_poses), 1);
  // The solver holds its first pose: nav's origin.
  (void)addNode(SE3());
}

std::size_t KeyframeStore::memoryBytes() const {
  return solver_.memoryBytes() + keyframes_.memoryBytes() + must_stay_.size() +
         (changed_.capacity() + keyframe_of_node_.size()) * sizeof(int);
}

bool KeyframeStore::isShort(std::size_t spare) const {
  const std::size_t room = at(config_.solver.max_measurements);
  return keyframes_.size() + std::min(spare, keyframes_.capacity() / 8) >= keyframes_.capacity() ||
         at(solver_.measurementsInUse()) + std::min(spare, room / 8) >= room;
}

int KeyframeStore::nearestInTime(int keyframe, std::int64_t utc_ns) const {
  const std::span<const int> all = living();
  const std::size_t after = keyframes_.position(keyframe);
  if (after == all.size()) return all[after - 1];
  if (after == 0) return all[0];
  const std::int64_t since = utc_ns - (*this)[all[after - 1]].utc_ns,
                     until = (*this)[all[after]].utc_ns - utc_ns;
  return since < until ? all[after - 1] : all[after];
}

void KeyframeStore::erase(int keyframe) {
  const Keyframe& gone = (*this)[keyframe];
  if (gone.waiting) changed_.erase(std::find(changed_.begin(), changed_.end(), keyframe));
  keyframe_of_node_[at(gone.node)] = -1;
  must_stay_[at(gone.node)] = 1;
  keyframes_.erase(keyframe);
}

int KeyframeStore::addNode(const SE3& pose) {
  int node = -1;
  return solver_.addPose(pose, &node) == AddStatus::kOk ? node : -1;
}

int KeyframeStore::addKeyframeNode(const SE3& pose) {
  const int node = addNode(pose);
  if (node < 0) return -1;
  keyframe_of_node_[at(node)] = next();
  must_stay_[at(node)] = 0;
  return node;
}

int KeyframeStore::addFactor(const RelativePose& factor) {
  int measurement = -1;
  return solver_.addMeasurement(factor, &measurement) == AddStatus::kOk ? measurement : -1;
}

Vector6d perturbationOf(const RelativePose& factor, const SE3& T_from, const SE3& T_to) {
  Vector6d e = relativePoseError(factor, T_from, T_to);
  e.tail<3>() *= 2;
  return e;
}

double KeyframeStore::distance2(const RelativePose& factor, const Matrix6d& covariance) const {
  const Vector6d e = perturbationOf(factor, solver_.pose(factor.from), solver_.pose(factor.to));
  return e.dot(covariance.ldlt().solve(e));
}

void KeyframeStore::weigh(Keyframe& k) {
  const bool visual = k.visualAccepted(), dvl = k.step >= 0 && !k.dvl_rejected,
             compass = k.heading.compass && !k.mixed_reference;
  const auto set = [&](int measurement, double weight) {
    if (measurement >= 0 && solver_.measurement(measurement).weight != weight)
      (void)solver_.setWeight(measurement, weight);
  };
  set(k.step, dvl ? k.step_weight : visual ? 0 : kInflated);
  const bool joined = dvl && k.quality.seconds_unlocked == 0;
  set(k.link, visual ? 1 : joined ? 0 : kInflated);
  set(k.attitude, compass ? 1 : kInflated);
  const auto count = [](std::uint64_t& counter, bool& counted, bool rejected) {
    counter += rejected ? 1U : 0U;
    counter -= counted ? 1U : 0U;
    counted = rejected;
  };
  count(counters_.compass_rejected, k.counted[0], k.attitude >= 0 && !compass);
  count(counters_.visual_rejected, k.counted[1], k.visualRejected());
  count(counters_.steps_left_out, k.counted[2], k.dvl_rejected);
}

void KeyframeStore::noteChanges() {
  for (const int node : solver_.moved()) {
    const int number = ofNode(node);
    if (number < 0 || (*this)[number].waiting) continue;
    Keyframe& keyframe = (*this)[number];
    const SE3 moved = keyframe.known.inverse() * solver_.pose(node);
    if (moved.translation().norm() <= config_.change_m &&
        2 * moved.rotation().vec().norm() <= config_.change_rad)
      continue;
    keyframe.waiting = true;
    changed_.push_back(number);
  }
}

std::optional<int> KeyframeStore::takeChange() {
  if (changed_.empty()) return std::nullopt;
  const auto moved = [&](int number) {
    const SE3 by = (*this)[number].known.inverse() * pose(number);
    return by.translation().norm() / config_.change_m + 2 * by.rotation().vec().norm() / config_.change_rad;
  };
  std::size_t best = 0;
  double most = moved(changed_[0]);
  for (std::size_t i = 1; i < changed_.size(); ++i)
    if (const double m = moved(changed_[i]); m > most || (m == most && changed_[i] > changed_[best])) {
      most = m;
      best = i;
    }
  const int number = changed_[best];
  changed_[best] = changed_.back();
  changed_.pop_back();
  noteTaken(number);
  return number;
}

void KeyframeStore::takeAllChanges() {
  for (const int number : changed_) noteTaken(number);
  changed_.clear();
}

bool KeyframeStore::rebuildIndices() {
  std::fill(keyframe_of_node_.begin(), keyframe_of_node_.end(), -1);
  std::fill(must_stay_.begin(), must_stay_.end(), 1);
  // The newest keyframes never retire.
  const int newest = next() - 1;
  if (!isNode(0) || (living().empty() ? newest >= 0 : living().back() != newest)) return false;
  std::size_t waiting = 0;
  std::int64_t before_ns = std::numeric_limits<std::int64_t>::min();
  for (const int number : living()) {
    const Keyframe& k = (*this)[number];
    const auto isFactor = [&](int measurement) { return measurement == -1 || isMeasurement(measurement); };
    if (k.node <= 0 || !isNode(k.node) || ofNode(k.node) >= 0 || !isFactor(k.step) || !isFactor(k.attitude) ||
        !isFactor(k.drift) || !isFactor(k.link) || before_ns > k.utc_ns)
      return false;
    keyframe_of_node_[at(k.node)] = number;
    must_stay_[at(k.node)] = 0;
    before_ns = k.utc_ns;
    waiting += k.waiting ? 1 : 0;
  }
  std::vector<int> changed(changed_);
  std::sort(changed.begin(), changed.end());
  if (std::adjacent_find(changed.begin(), changed.end()) != changed.end()) return false;
  const auto waits = [&](int k) { return has(k) && (*this)[k].waiting; };
  return changed.size() == waiting && std::all_of(changed.begin(), changed.end(), waits);
}

}  // namespace fathom::slam

#include "recon/navigation/gating/link_gate.hpp"

#include <algorithm>

namespace fathom::slam {
namespace {

// Poses turned by more are not left to a solver that descends from where they are [rad].
constexpr double kFarTurned = 0.3;

}  // namespace

LinkGate::LinkGate(KeyframeStore& keyframes, DvlCalibration& dvl, SharedTurns& turns, RobustFactors& robust,
                   FixGate& fixes, StepGate& steps, SensorReferences& references)
    : keyframes_(keyframes),
      dvl_(dvl),
      turns_(turns),
      robust_(robust),
      fixes_(fixes),
      steps_(steps),
      references_(references) {
  displaced_.reserve(static_cast<std::size_t>(keyframes.config().max_keyframes));
}

// Whether a closure that contradicts the graph agrees with so many others that did that the graph must be
// wrong: around the cycle a - b - b' - a' two of them and the graph's predictions of the short sides come
// back to where they began.
bool LinkGate::agreesWithRejected(int a, int b, const UncertainPose& link) {
  int agreeing = 1;
  for (const Rejected& other : rejected_) {
    if (!keyframes_.has(other.a) || !keyframes_.has(other.b)) continue;
    if (cycleDistance2(link, fixes_.predict(b, other.b), fixes_.predict(a, other.a), other.link) < kCycleGate)
      ++agreeing;
  }
  rejected_[next_rejected_++ % rejected_.size()] = {a, b, link};
  return agreeing >= keyframes_.config().reject_after;
}

// A vehicle that was lost is found: all that came after the last step without an accepted sensor is moved as
// one body to where the closure has keyframe b; the solver distributes the rest.
void LinkGate::displaceLost(int a, int b, const SE3& T_a_b) {
  const SE3 by = keyframes_.pose(a) * T_a_b * keyframes_.pose(b).inverse();
  const std::span<const int> all = keyframes_.living();
  auto first = std::upper_bound(all.begin(), all.end(), b);
  const auto isWeak = [&](int number) {
    const Keyframe& k = keyframes_[number];
    return k.compass_jumped || (!k.visualAccepted() && (k.dvl_rejected || k.quality.seconds_unlocked > 0));
  };
  while (first != all.begin() && *(first - 1) > a && !isWeak(*(first - 1))) --first;
  if (first == all.begin() || *(first - 1) <= a) return;
  --first;  // where the weak step ends
  displaced_.clear();
  for (auto k = first; k != all.end(); ++k) displaced_.push_back(keyframes_[*k].node);
  keyframes_.solver().displace(displaced_, by);
  // Their references of attitude turn with them.
  displaced_.clear();
  references_.appendAttitudeNodes(keyframes_[*first].utc_ns, displaced_);
  keyframes_.solver().displace(displaced_, SE3(by.rotation(), Eigen::Vector3d::Zero()));
  keyframes_.noteChanges();
}

Taken LinkGate::add(LinkKind kind, int a, int b, const SE3& seen, const Matrix6d& covariance,
                    bool confirmed) {
  NavigationCounters& counters = keyframes_.counters();
  const NavigationConfig& config = keyframes_.config();
  if (!keyframes_.has(a) || !keyframes_.has(b) || a == b || !covariance.allFinite()) {
    ++counters.links_refused;
    return Taken::kBad;
  }
  Keyframe& to = keyframes_[b];
  const SE3 T_a_b = dvl_.straightened(seen, to.range);
  const Matrix6d spread = covariance + dvl_.leftOpen(T_a_b, to.range);
  const RelativePose factor = linkFactor(keyframes_[a].node, to.node, T_a_b, spread);
  const bool chain =
      kind == LinkKind::kOdometry && b == a + 1 && b == keyframes_.next() - 1 && steps_.waits();
  if ((!chain && robust_.isFull()) || !factor.information.allFinite()) {
    ++counters.links_refused;
    return Taken::kFull;
  }
  const bool agreed = kind == LinkKind::kAgreed;
  if (!chain && !agreed) {
    const Matrix6d known = fixes_.predict(a, b).covariance;
    const bool fits = keyframes_.distance2(factor, config.known_scale * known + spread) <= config.gate;
    if (!fits) ++counters.links_contradicting;
    if (!fits && !agreesWithRejected(a, b, {T_a_b, spread})) return Taken::kContradicts;
  }
  const SE3 &T_nav_a = keyframes_.pose(a), &T_nav_b = keyframes_.pose(b);
  if (agreed && b > a && T_nav_b.rotation().angularDistance((T_nav_a * T_a_b).rotation()) > kFarTurned)
    displaceLost(a, b, T_a_b);
  const int measurement = keyframes_.addFactor(factor);
  if (measurement < 0) {
    ++counters.links_refused;
    return Taken::kFull;
  }
  ++(kind == LinkKind::kOdometry ? counters.odometry_links : counters.closures);
  if (chain) {
    to.link = measurement;
    turns_.hang(to.node, factor.from, keyframes_.pose(b), turnedBy(T_a_b, to.range));
    steps_.setLink({T_a_b, covariance}, seen, confirmed);
    to.visual_turn = {seen, covariance, turns_.rigEpoch()};
  } else {
    if (!agreed && a < b) turns_.learnFromYaw(a, b, {seen, covariance});
    robust_.add({factor.from, factor.to, T_a_b, spread, measurement, kLinkFree, 1, false, false, agreed,
                 dvl_.curl(), turns_.curlEpoch()});
  }
  return Taken::kYes;
}

}  // namespace fathom::slam

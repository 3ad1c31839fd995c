#include "realtime/onboard/localisation/closure_search.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <tuple>

namespace fathom::onboard {
namespace {

constexpr int kSkip = 4;  // latest keyframes that odometry links well enough
// No separation beyond so many reaches has a probability of overlap worth trying, however wide the
// uncertainty: along one axis it is at most 2 reach / distance x 0.242.
constexpr double kFarthest = 10;
// Expected information below which a pair is not worth a registration [nat]. Not a probability: lost by
// several footprints, no pair is probable, but any closure tells more than all else.
constexpr double kLeastValue = 0.04;
constexpr double kWide = 1.0;         // of a prior, in radii of the footprint: several places would fit
constexpr double kLeastSigma = 0.05;  // of a prior [m]: what the graph does not know of itself
constexpr double kLeastAngle = 0.03;  // [rad]
constexpr std::size_t kUnconfirmed = 64;
constexpr int kNeighbours = 6;  // keyframes within which two closures may confirm each other
constexpr int kSpan = 2 * kNeighbours + 1;
constexpr std::size_t kSought = 6;      // pairs that are tried to confirm one
constexpr double kFirst = 1e6;          // information above any other [nat]
constexpr double kCycle = 16.81;        // chi-square with 6 degrees of freedom, 99 %
constexpr int kLookedAt = 64;           // keyframes that proposeMoved() looks at
constexpr double kMoved = 0.5;          // radii
constexpr std::size_t kTried = 100000;  // pairs

closure::CandidateConfig limitsOf(const LocalisationConfig& config) {
  closure::CandidateConfig limits;
  limits.capacity = config.closures_waiting;
  return limits;
}

}  // namespace

ClosureSearch::ClosureSearch(const StereoRig& rig, const LocalisationConfig& config,
                             slam::NavigationGraph& graph, KeyframeFeatures& features)
    : camera_(rig.left),
      config_(config),
      graph_(graph),
      features_(features),
      registrar_(rig, {}),
      queue_(limitsOf(config)),
      limits_(limitsOf(config)),
      reach_(closure::separationOfOverlap(limits_.min_overlap)),
      views_(static_cast<std::size_t>(config.max_keyframes)),
      tried_(kTried) {
  near_.reserve(static_cast<std::size_t>(std::max(config.predictions_per_keyframe, kSpan * kSpan)) + 1);
  unconfirmed_.reserve(kUnconfirmed + 1);
  closures_.reserve(static_cast<std::size_t>(config.graph.max_links));
}

std::size_t ClosureSearch::memoryBytes() const {
  return tried_.memoryBytes() + views_.memoryBytes() +
         (unconfirmed_.capacity() + closures_.capacity()) * sizeof(Closure) +
         config_.closures_waiting * sizeof(closure::Candidate);
}

closure::Footprint ClosureSearch::footprint(int keyframe) const {
  return closure::footprintOf(graph_.pose(keyframe), views_[static_cast<std::size_t>(keyframe)].range,
                              camera_);
}

ClosureSearch::Seen ClosureSearch::look(int a, int b) {
  ++counters_.predictions;
  Seen seen{{}, graph_.predict(a, b), 0};
  const Eigen::Matrix3d R = graph_.pose(b).matrix3();
  const Eigen::Matrix2d spread =
      (R * seen.prediction.covariance.topLeftCorner<3, 3>() * R.transpose()).topLeftCorner<2, 2>();
  const closure::Footprint here = footprint(b), there = footprint(a);
  seen.candidate = {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b),
                    closure::overlapProbability(here.centre - there.centre, spread,
                                                reach_ * 0.5 * (here.radius + there.radius)),
                    closure::expectedInformation(spread, limits_.sigma_measured)};
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(spread, Eigen::EigenvaluesOnly);
  seen.sigma = std::sqrt(std::max(axes.eigenvalues()(1), 0.0));
  return seen;
}

bool ClosureSearch::worthIt(const closure::Candidate& candidate) const {
  return candidate.value() >= kLeastValue && candidate.information >= limits_.min_information;
}

void ClosureSearch::propose(int keyframe) {
  if (!features_.has(keyframe)) return;
  const closure::Footprint here = footprint(keyframe);
  views_[static_cast<std::size_t>(keyframe)].proposed_at = here.centre;
  const auto nearer = [](const Near& x, const Near& y) {
    return std::tie(x.distance2, y.keyframe) < std::tie(y.distance2, x.keyframe);
  };
  near_.clear();
  const auto most = static_cast<std::size_t>(config_.predictions_per_keyframe);
  for (const int other : graph_.living()) {
    if (std::abs(other - keyframe) < kSkip || !features_.has(other)) continue;
    const closure::Footprint there = footprint(other);
    const double farthest = kFarthest * reach_ * 0.5 * (here.radius + there.radius);
    const double distance2 = (here.centre - there.centre).squaredNorm();
    if (!(distance2 < farthest * farthest)) continue;
    if (tried_.contains(std::min(other, keyframe), std::max(other, keyframe))) continue;
    near_.push_back({distance2, other});
    std::push_heap(near_.begin(), near_.end(), nearer);
    if (near_.size() <= most) continue;
    std::pop_heap(near_.begin(), near_.end(), nearer);
    near_.pop_back();
  }
  std::sort_heap(near_.begin(), near_.end(), nearer);
  for (const Near& n : near_) {
    const Seen seen = look(std::min(n.keyframe, keyframe), std::max(n.keyframe, keyframe));
    if (!worthIt(seen.candidate)) continue;
    ++counters_.proposed;
    queue_.push(seen.candidate);
  }
}

void ClosureSearch::proposeMoved() {
  for (int looked = 0; looked < kLookedAt && !views_.empty(); ++looked) {
    next_moved_ = (next_moved_ == 0 ? views_.size() : std::min(next_moved_, views_.size())) - 1;
    const int keyframe = views_.numbers()[next_moved_];
    const closure::Footprint now = footprint(keyframe);
    const Eigen::Vector2d& before = views_[static_cast<std::size_t>(keyframe)].proposed_at;
    if ((now.centre - before).norm() < kMoved * now.radius) continue;
    propose(keyframe);
    return;
  }
}

void ClosureSearch::work(int registrations) {
  closure::Candidate candidate;
  while (registrations > 0 && queue_.pop(candidate)) {
    const int a = static_cast<int>(candidate.older), b = static_cast<int>(candidate.newer);
    if (!graph_.has(a) || !graph_.has(b)) {
      ++counters_.stale;
      continue;
    }
    if (tried_.contains(a, b)) continue;
    // What was learnt since it was queued may have made it hopeless or needless.
    const Seen seen = look(a, b);
    const bool sought = candidate.information >= 0.5 * kFirst;
    if (!sought && !worthIt(seen.candidate)) {
      ++counters_.stale;
      continue;
    }
    (void)tried_.insert(a, b);
    registerPair(seen);
    --registrations;
  }
}

void ClosureSearch::registerPair(const Seen& seen) {
  const int a = static_cast<int>(seen.candidate.older), b = static_cast<int>(seen.candidate.newer);
  const closure::FrameFeatures *there = features_.find(a), *here = features_.find(b);
  if (there == nullptr || here == nullptr) return;
  closure::RelativePrior prior{seen.prediction.T_a_b, seen.prediction.covariance};
  prior.covariance.diagonal().head<3>().array() += kLeastSigma * kLeastSigma;
  prior.covariance.diagonal().tail<3>().array() += kLeastAngle * kLeastAngle;
  ++counters_.registrations;
  const closure::Registration& found = registrar_.process(*there, *here, prior);
  ++counters_.refused[static_cast<std::size_t>(found.refusal)];
  if (!found.accepted()) return;
  ++counters_.accepted;
  const Closure closure{a, b, found.T_a_b, found.covariance, static_cast<int>(found.inliers.size()), false};
  if (seen.sigma > kWide * footprint(b).radius)
    confirm(closure);
  else
    keep(closure);
}

void ClosureSearch::keep(const Closure& closure) {
  if (graph_.addLink(slam::LinkKind::kClosure, closure.a, closure.b, closure.T_a_b, closure.covariance) !=
      slam::Taken::kYes) {
    ++counters_.contradicting;
    return;
  }
  if (closures_.size() < closures_.capacity()) closures_.push_back(closure);
}

// Around the cycle a - b - b' - a' the two closures and what the graph knows of each side must come back to
// where they began. The sides are short, so their uncertainty is that of odometry.
bool ClosureSearch::agrees(const Closure& x, const Closure& y) {
  const auto side = graph_.predict(x.a, y.a), far_side = graph_.predict(x.b, y.b);
  const SE3 by_x = x.T_a_b * far_side.T_a_b, by_y = side.T_a_b * y.T_a_b;
  const auto moved = [](const SE3& T, const Matrix6d& covariance) -> Matrix6d {
    // Right perturbation of X in X T, as one of the product: Ad(T^-1).
    const SE3 back = T.inverse();
    const Eigen::Matrix3d R = back.matrix3();
    Eigen::Matrix3d hat;
    const Eigen::Vector3d& t = back.translation();
    hat << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
    Matrix6d adjoint = Matrix6d::Zero();
    adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = R;
    adjoint.topRightCorner<3, 3>() = hat * R;
    return adjoint * covariance * adjoint.transpose();
  };
  const Matrix6d spread = moved(far_side.T_a_b, x.covariance) + far_side.covariance +
                          moved(y.T_a_b, side.covariance) + y.covariance;
  const Vector6d off = (by_x.inverse() * by_y).log();
  return off.dot(spread.ldlt().solve(off)) < kCycle;
}

void ClosureSearch::retire(int keyframe) {
  views_.erase(keyframe);
  const auto names = [&](const Closure& c) { return c.a == keyframe || c.b == keyframe; };
  counters_.unconfirmed += std::erase_if(unconfirmed_, names);
}

void ClosureSearch::confirm(const Closure& closure) {
  ++counters_.waited;
  for (std::size_t i = unconfirmed_.size(); i-- > 0;) {
    const Closure other = unconfirmed_[i];
    const int da = std::abs(other.a - closure.a), db = std::abs(other.b - closure.b);
    if (da == 0 || db == 0 || da > kNeighbours || db > kNeighbours || !agrees(closure, other)) continue;
    unconfirmed_.erase(unconfirmed_.begin() + static_cast<std::ptrdiff_t>(i));
    counters_.confirmed += 2;
    for (Closure sure : {other, closure}) {
      sure.confirmed = true;
      keep(sure);
    }
    return;
  }
  if (unconfirmed_.size() == kUnconfirmed) {
    unconfirmed_.erase(unconfirmed_.begin());
    ++counters_.unconfirmed;
  }
  unconfirmed_.push_back(closure);
  seekNeighbours(closure);
}

// Pairs beside a closure that waits come before all others: those that would overlap most if it is true. They
// are registered with what the graph knows as prior, as any pair, so that they can contradict it.
void ClosureSearch::seekNeighbours(const Closure& closure) {
  near_.clear();
  const auto number = [](int da, int db) { return (da + kNeighbours) * kSpan + db + kNeighbours; };
  for (int da = -kNeighbours; da <= kNeighbours; ++da) {
    for (int db = -kNeighbours; db <= kNeighbours; ++db) {
      const int a = closure.a + da, b = closure.b + db;
      if (da == 0 || db == 0 || b - a < kSkip) continue;
      if (tried_.contains(a, b) || !features_.has(a) || !features_.has(b)) continue;
      const SE3 T_a_b = (graph_.pose(a).inverse() * graph_.pose(closure.a)) * closure.T_a_b *
                        (graph_.pose(closure.b).inverse() * graph_.pose(b));
      near_.push_back({T_a_b.translation().squaredNorm(), number(da, db)});
    }
  }
  std::sort(near_.begin(), near_.end(), [](const Near& x, const Near& y) {
    return std::tie(x.distance2, x.keyframe) < std::tie(y.distance2, y.keyframe);
  });
  const std::size_t sought = std::min<std::size_t>(near_.size(), kSought);
  for (std::size_t k = 0; k < sought; ++k) {
    const int a = closure.a + near_[k].keyframe / kSpan - kNeighbours;
    const int b = closure.b + near_[k].keyframe % kSpan - kNeighbours;
    queue_.push({static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b), 1.0,
                 kFirst - std::sqrt(near_[k].distance2)});
  }
}

ClosureSearch::Counters ClosureSearch::counters() const {
  Counters out = counters_;
  out.waiting = queue_.size();
  out.dropped = queue_.dropped();
  out.unconfirmed_now = unconfirmed_.size();
  return out;
}

}  // namespace fathom::onboard

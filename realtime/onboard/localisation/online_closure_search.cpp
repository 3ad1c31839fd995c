#include "realtime/onboard/localisation/online_closure_search.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <tuple>

#include "recon/closure/registration.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::onboard {
namespace {

constexpr int kSkip = 4;  // latest keyframes that odometry links well enough
// Standard deviations of the relative position of two keyframes within which they are sought.
constexpr double kSigmas = 3;
// Expected information below which a pair is not worth a registration [nat]. Not a probability: lost by
// several footprints, no pair is probable, but any closure is most informative.
constexpr double kLeastValue = 0.04;
// Horizontal, of a registration on level ground [m]; a pair that is known as well is not worth one.
constexpr double kMeasured = 0.007;
constexpr double kWide = 1.0;         // of a prior, in radii of the footprint: several places would fit
constexpr double kLeastSigma = 0.05;  // of a prior [m]: what the graph does not know of itself
constexpr double kLeastAngle = 0.03;  // [rad]
constexpr int kNeighbours = closure::Agreement::kNeighbours;
constexpr int kSpan = 2 * kNeighbours + 1;
constexpr std::size_t kSought = 6;      // pairs that are tried to confirm one
constexpr double kFirst = 1e6;          // information above any other [nat]
constexpr int kLookedAt = 64;           // keyframes that proposeMoved() looks at
constexpr double kMoved = 0.5;          // radii
constexpr std::size_t kTried = 100000;  // pairs
// Keyframes without a closure after which the newest are recognised; and latest ones without new information.
constexpr int kQuiet = 10, kRecent = 20;
constexpr std::size_t kMostSought = 32;
constexpr int kStepsFound = 4;  // of the graph at once, when a place that was recognised moves poses far

closure::PlaceIndexConfig placesOf(const LocalisationConfig& config) {
  closure::PlaceIndexConfig places;
  places.max_places = config.max_keyframes;
  return places;
}

closure::CandidateConfig limitsOf(const LocalisationConfig& config) {
  closure::CandidateConfig limits;
  limits.capacity = config.closures_waiting;
  limits.sigma_measured = kMeasured;
  return limits;
}

}  // namespace

OnlineClosureSearch::OnlineClosureSearch(const StereoRig& rig, const LocalisationConfig& config,
                                         slam::NavigationGraph& graph, KeyframeFeatures& features)
    : camera_(rig.left),
      config_(config),
      graph_(graph),
      features_(features),
      registrar_(rig, {}),
      strict_(rig, closure::recognitionRules()),
      queue_(limitsOf(config)),
      limits_(limitsOf(config)),
      reach_(closure::separationOfOverlap(limits_.min_overlap)),
      tried_(kTried),
      recognised_(kTried),
      places_(placesOf(config)),
      odometry_([this](int x, int y) { return graph_.predict(x, y); }) {
  views_.reserve(static_cast<std::size_t>(config.max_keyframes));
  near_.reserve(static_cast<std::size_t>(std::max(config.predictions_per_keyframe, kSpan * kSpan)) + 1);
  samples_.reserve(kSamples);
  sought_.reserve(kMostSought + kSought);
  closures_.reserve(static_cast<std::size_t>(config.graph.max_links));
}

std::size_t OnlineClosureSearch::memoryBytes() const {
  return tried_.memoryBytes() + recognised_.memoryBytes() + places_.memoryBytes() +
         views_.capacity() * sizeof(View) + closures_.capacity() * sizeof(Closure) +
         closure::Agreement::kWaiting * sizeof(closure::Claim) +
         config_.closures_waiting * sizeof(closure::Candidate);
}

void OnlineClosureSearch::addKeyframe(int keyframe, double range) {
  views_.push_back({keyframe, range, Eigen::Vector2d::Zero()});
  if (const closure::FrameFeatures* here = features_.find(keyframe)) (void)places_.add(keyframe, *here);
}

void OnlineClosureSearch::removeKeyframe(int keyframe) {
  const std::size_t view = viewOf(keyframe);
  if (view == views_.size()) return;
  views_.erase(views_.begin() + static_cast<std::ptrdiff_t>(view));
  places_.remove(keyframe);
  agreement_.remove(keyframe);
}

std::size_t OnlineClosureSearch::viewOf(int keyframe) const {
  const auto at = std::lower_bound(views_.begin(), views_.end(), keyframe,
                                   [](const View& v, int wanted) { return v.keyframe < wanted; });
  const bool there = at != views_.end() && at->keyframe == keyframe;
  return there ? static_cast<std::size_t>(at - views_.begin()) : views_.size();
}

closure::Footprint OnlineClosureSearch::footprint(const View& view) const {
  return closure::footprintOf(graph_.pose(view.keyframe), view.range, camera_);
}

closure::Footprint OnlineClosureSearch::footprint(int keyframe) const {
  return footprint(views_[viewOf(keyframe)]);
}

OnlineClosureSearch::Seen OnlineClosureSearch::look(int a, int b) {
  ++counters_.predictions;
  Seen seen;
  seen.prediction = graph_.predict(a, b);
  const Eigen::Matrix3d R = graph_.pose(b).matrix3();
  seen.spread = (R * seen.prediction.covariance.topLeftCorner<3, 3>() * R.transpose()).topLeftCorner<2, 2>();
  const closure::Footprint here = footprint(b), there = footprint(a);
  seen.separation = here.centre - there.centre;
  seen.candidate = {
      static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b),
      closure::overlapProbability(seen.separation, seen.spread, reach_ * 0.5 * (here.radius + there.radius)),
      closure::expectedInformation(seen.spread, limits_.sigma_measured)};
  seen.sigma = std::sqrt(std::max(symmetricEigenvalues(seen.spread)(1), 0.0));
  return seen;
}

bool OnlineClosureSearch::worthIt(const closure::Candidate& candidate) const {
  return candidate.value() >= kLeastValue && candidate.information >= limits_.min_information;
}

// Asks the graph for the relative position of a few keyframes, spread over the dive.
void OnlineClosureSearch::sample(int keyframe) {
  samples_.clear();
  const std::size_t count = std::min(views_.size(), kSamples);
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t view = count == 1 ? 0 : k * (views_.size() - 1) / (count - 1);
    const int other = views_[view].keyframe;
    Sample sample{view, Eigen::Matrix2d::Zero()};
    if (other != keyframe) sample.spread = look(std::min(other, keyframe), std::max(other, keyframe)).spread;
    samples_.push_back(sample);
  }
}

// Between two samples the wider one serves.
const Eigen::Matrix2d& OnlineClosureSearch::spreadAbout(std::size_t view) const {
  std::size_t next = 1;
  while (next + 1 < samples_.size() && samples_[next].view < view) ++next;
  if (samples_.size() == 1) return samples_[0].spread;
  const Eigen::Matrix2d &before = samples_[next - 1].spread, &after = samples_[next].spread;
  return before.trace() > after.trace() ? before : after;
}

void OnlineClosureSearch::propose(int keyframe) {
  const std::size_t own = viewOf(keyframe);
  if (own == views_.size() || !features_.has(keyframe)) return;
  const closure::Footprint here = footprint(views_[own]);
  views_[own].proposed_at = here.centre;
  sample(keyframe);
  const auto nearer = [](const Near& x, const Near& y) {
    return std::tie(x.rank, y.keyframe) < std::tie(y.rank, x.keyframe);
  };
  near_.clear();
  const auto most = static_cast<std::size_t>(config_.predictions_per_keyframe);
  for (std::size_t view = 0; view < views_.size(); ++view) {
    const int other = views_[view].keyframe;
    if (std::abs(other - keyframe) < kSkip || !features_.has(other)) continue;
    const closure::Footprint there = footprint(views_[view]);
    const Eigen::Vector2d separation = other < keyframe ? Eigen::Vector2d(here.centre - there.centre)
                                                        : Eigen::Vector2d(there.centre - here.centre);
    // Three standard deviations, and the reach of the footprints where the relative position is certain.
    const double reach = reach_ * 0.5 * (here.radius + there.radius);
    const Eigen::Matrix2d within =
        spreadAbout(view) + Eigen::Matrix2d::Identity() * (reach * reach / (kSigmas * kSigmas));
    const double distance2 = separation.dot(within.inverse() * separation);
    if (!(distance2 < kSigmas * kSigmas)) continue;
    if (tried_.contains(std::min(other, keyframe), std::max(other, keyframe), separation)) continue;
    near_.push_back({distance2 + std::log(within.determinant()), other});
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

void OnlineClosureSearch::proposeMoved() {
  for (int looked = 0; looked < kLookedAt && !views_.empty(); ++looked) {
    next_moved_ = next_moved_ == 0 || next_moved_ > views_.size() ? views_.size() - 1 : next_moved_ - 1;
    const View& view = views_[next_moved_];
    const closure::Footprint now = footprint(view);
    if ((now.centre - view.proposed_at).norm() < kMoved * now.radius) continue;
    propose(view.keyframe);
    return;
  }
}

void OnlineClosureSearch::work(int registrations) {
  closure::Candidate candidate;
  while (registrations > 0 && queue_.pop(candidate)) {
    const int a = static_cast<int>(candidate.older), b = static_cast<int>(candidate.newer);
    if (viewOf(a) == views_.size() || viewOf(b) == views_.size()) continue;
    // What was learnt since it was queued may have made it hopeless or needless.
    const Seen seen = look(a, b);
    if (tried_.contains(a, b, seen.separation)) continue;
    const bool sought = candidate.information >= 0.5 * kFirst;
    if (!sought && !worthIt(seen.candidate)) {
      ++counters_.stale;
      continue;
    }
    tried_.insert(a, b, seen.separation, std::max(seen.sigma, kMoved * footprint(b).radius));
    registerPair(seen);
    --registrations;
  }
}

void OnlineClosureSearch::registerPair(const Seen& seen) {
  const int a = static_cast<int>(seen.candidate.older), b = static_cast<int>(seen.candidate.newer);
  const closure::FrameFeatures *there = features_.find(a), *here = features_.find(b);
  if (there == nullptr || here == nullptr) return;
  closure::RelativePrior prior = seen.prediction;
  prior.covariance.diagonal().head<3>().array() += kLeastSigma * kLeastSigma;
  prior.covariance.diagonal().tail<3>().array() += kLeastAngle * kLeastAngle;
  ++counters_.registrations;
  const closure::Registration& found = registrar_.process(*there, *here, prior);
  ++counters_.refused[static_cast<std::size_t>(found.refusal)];
  if (!found.accepted()) return;
  // One other claim will do: the prior is one that agrees.
  accept({a, b, found.T_a_b, found.covariance, static_cast<int>(found.inliers.size())}, seen, true);
}

void OnlineClosureSearch::recognise(int keyframe) {
  const closure::FrameFeatures* here = features_.find(keyframe);
  const bool quiet = keyframe - last_closed_ >= kQuiet;
  int left = config_.place_tries;
  if (quiet && here != nullptr) {
    const auto wanted = [&](int id) {
      return keyframe - id >= kRecent && !recognised_.contains(id, keyframe);
    };
    // Half of them, so that some are left for what then needs others to agree.
    for (const auto& place : places_.query(*here, static_cast<std::size_t>((left + 1) / 2), wanted)) {
      registerUnknown(place.id, keyframe);
      --left;
    }
  }
  while (left > 0 && !sought_.empty()) {
    const Pair pair = sought_.back();
    sought_.pop_back();
    if (recognised_.contains(pair.a, pair.b)) continue;
    registerUnknown(pair.a, pair.b);
    --left;
  }
}

void OnlineClosureSearch::registerUnknown(int a, int b) {
  recognised_.insert(a, b);
  if (viewOf(a) == views_.size() || viewOf(b) == views_.size()) return;
  const closure::FrameFeatures *there = features_.find(a), *here = features_.find(b);
  if (there == nullptr) places_.remove(a);  // its slot was given to another
  if (there == nullptr || here == nullptr) return;
  ++counters_.places_tried;
  const closure::Registration& found = strict_.process(*there, *here, std::nullopt);
  if (!found.accepted() || !closure::fitsDownAndDepth(graph_.pose(a), graph_.pose(b), found.T_a_b)) return;
  ++counters_.places_accepted;
  const Seen seen = look(a, b);
  Matrix6d known = config_.graph.known_scale * seen.prediction.covariance;
  known.diagonal().head<3>().array() += kLeastSigma * kLeastSigma;
  known.diagonal().tail<3>().array() += kLeastAngle * kLeastAngle;
  const bool fits = closure::distanceFromPrior(found.T_a_b, found.covariance, seen.prediction.T_a_b, known) <=
                    config_.graph.gate;
  accept(closure::recognitionOf(a, b, {found.T_a_b, found.covariance}, static_cast<int>(found.inliers.size()),
                                footprint(b).radius),
         seen, fits);
}

// `fits`: it agrees with what the graph knows; where that is certain already, it says that nobody is lost.
void OnlineClosureSearch::accept(const closure::Claim& claim, const Seen& seen, bool fits) {
  ++counters_.accepted;
  if (fits && seen.sigma <= kWide * footprint(claim.b).radius) {
    last_closed_ = std::max(last_closed_, claim.b);
    if (seen.candidate.information >= limits_.min_information) keep(slam::LinkKind::kClosure, claim, false);
    return;
  }
  ++counters_.waited;
  const std::span<const closure::Claim> agreed = agreement_.add(claim, odometry_);
  if (agreed.empty()) {
    seekNeighbours(claim);
    return;
  }
  counters_.confirmed += agreed.size();
  const bool unknown = std::any_of(agreed.begin(), agreed.end(), [](const auto& c) { return c.wanted > 2; });
  if (unknown) counters_.recognised += agreed.size();
  for (const closure::Claim& sure : agreed)
    keep(unknown ? slam::LinkKind::kAgreed : slam::LinkKind::kClosure, sure, true);
  for (int step = 0; unknown && step < kStepsFound; ++step) (void)graph_.step();
}

void OnlineClosureSearch::keep(slam::LinkKind kind, const closure::Claim& claim, bool confirmed) {
  if (graph_.addLink(kind, claim.a, claim.b, claim.T_a_b, claim.covariance) != slam::Taken::kYes) {
    ++counters_.contradicting;
    return;
  }
  last_closed_ = std::max(last_closed_, claim.b);
  if (closures_.size() < closures_.capacity())
    closures_.push_back({claim.a, claim.b, claim.T_a_b, claim.covariance, claim.inliers, confirmed});
}

// Pairs beside a closure that waits come before all others: those that would overlap most if it is true.
// Those that fit what the graph knows are registered with that as prior, as any pair, so that they can
// contradict it; the others without.
void OnlineClosureSearch::seekNeighbours(const closure::Claim& claim) {
  near_.clear();
  const auto number = [](int da, int db) { return (da + kNeighbours) * kSpan + db + kNeighbours; };
  for (int da = -kNeighbours; da <= kNeighbours; ++da) {
    for (int db = -kNeighbours; db <= kNeighbours; ++db) {
      const int a = claim.a + da, b = claim.b + db;
      if (da == 0 || db == 0 || b - a < kSkip || viewOf(a) == views_.size() || viewOf(b) == views_.size())
        continue;
      if (!features_.has(a) || !features_.has(b)) continue;
      if (claim.wanted > 2 ? recognised_.contains(a, b)
                           : tried_.contains(a, b, footprint(b).centre - footprint(a).centre))
        continue;
      const SE3 T_a_b = (graph_.pose(a).inverse() * graph_.pose(claim.a)) * claim.T_a_b *
                        (graph_.pose(claim.b).inverse() * graph_.pose(b));
      near_.push_back({T_a_b.translation().squaredNorm(), number(da, db)});
    }
  }
  std::sort(near_.begin(), near_.end(), [](const Near& x, const Near& y) {
    return std::tie(x.rank, x.keyframe) < std::tie(y.rank, y.keyframe);
  });
  const std::size_t sought = std::min<std::size_t>(near_.size(), kSought);
  for (std::size_t k = sought; k-- > 0;) {
    const int a = claim.a + near_[k].keyframe / kSpan - kNeighbours;
    const int b = claim.b + near_[k].keyframe % kSpan - kNeighbours;
    if (claim.wanted > 2)
      sought_.push_back({a, b});
    else
      queue_.push({static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b), 1.0,
                   kFirst - std::sqrt(near_[k].rank)});
  }
  if (sought_.size() > kMostSought)
    sought_.erase(sought_.begin(), sought_.end() - static_cast<std::ptrdiff_t>(kMostSought));
}

OnlineClosureSearch::Counters OnlineClosureSearch::counters() const {
  Counters out = counters_;
  out.waiting = queue_.size();
  out.dropped = queue_.dropped();
  out.unconfirmed = agreement_.forgotten();
  out.unconfirmed_now = agreement_.waiting().size();
  return out;
}

}  // namespace fathom::onboard

#include "recon/topside/localise/batch_closure_search.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/progress.hpp"

namespace fathom::topside {
namespace {

namespace tbb = oneapi::tbb;

constexpr double kLeastSigma = 0.05, kLeastAngle = 0.02;  // of a prior for a closure [m], [rad]
constexpr double kPriorScale = 4;   // of a prior's covariance: the solution may rest on a wrong closure
constexpr std::uint32_t kSkip = 4;  // latest frames that odometry links well enough, where it does
// Expected information below which a pair is not worth a registration [nat]. Not a probability: lost by
// several footprints, no pair is probable, but any closure tells more than all else.
constexpr double kLeastValue = 0.04;
constexpr double kMovedAgain = 16.81;     // squared sigmas of its old prior by which a refused pair has moved
constexpr double kWide = 1.0;             // of a prior, in radii of the footprint: several places would fit
constexpr std::uint32_t kNeighbours = 6;  // frames within which two closures may confirm each other
constexpr double kAway = 8;               // radii of track by which the vehicle was away and came back
constexpr std::size_t kPathBytes = 48 * 1024 * 1024;  // of one thread and kind [bytes]
constexpr std::size_t kGrain = 16;  // stretches that a thread takes at once: paths are shared

std::uint64_t keyOf(std::uint32_t a, std::uint32_t b) {
  return std::uint64_t{a} << 32 | b;
}

bool byWorth(const closure::Candidate& x, const closure::Candidate& y) {
  return std::make_tuple(-x.value(), x.newer, x.older) < std::make_tuple(-y.value(), y.newer, y.older);
}

bool byFrame(const closure::Candidate& x, const closure::Candidate& y) {
  return std::tie(x.newer, x.older) < std::tie(y.newer, y.older);
}

// Of features `range` away through a rig of which so much is open [m].
closure::SharedErrors sharedErrors(const StereoRig& rig, const slam::RigPrior& open, double half_view,
                                   double range) {
  closure::SharedErrors errors;
  errors.disparity = hypotenuse(errors.disparity, open.scale * rig.left.fx * rig.baseline() / range);
  errors.disparity_slope = hypotenuse(errors.disparity_slope, open.uneven / half_view);
  errors.disparity_curve = open.uneven / (half_view * half_view);
  return errors;
}

}  // namespace

std::vector<Attempt> attemptsOf(const FramePairs& pairs) {
  std::vector<Attempt> attempts(pairs.size());
  for (std::size_t k = 0; k < pairs.size(); ++k) std::tie(attempts[k].a, attempts[k].b) = pairs[k];
  return attempts;
}

slam::NavigationLink linkOf(const closure::Claim& claim) {
  slam::NavigationLink link;
  link.a = static_cast<std::uint32_t>(claim.a);
  link.b = static_cast<std::uint32_t>(claim.b);
  link.T_a_b = claim.T_a_b;
  link.covariance = claim.covariance;
  link.inliers = claim.inliers;
  return link;
}

Matrix6d covarianceOf(double position, double angle) {
  Vector6d variance;
  variance << Eigen::Vector3d::Constant(position * position), Eigen::Vector3d::Constant(angle * angle);
  return variance.asDiagonal();
}

void registerAll(const StereoRig& rig, const Frames& frames, const closure::RegistrationConfig& config,
                 std::vector<Attempt>& attempts, const char* stage) {
  constexpr std::uint32_t kNothing = ~0U;
  struct Worker {
    std::unique_ptr<closure::Registrar> registrar;
    closure::FrameFeatures a, b;
    std::uint32_t loaded = kNothing;  // frame that is in b
  };
  tbb::enumerable_thread_specific<Worker> workers;
  rt::StageProgress progress(stage, attempts.size());
  tbb::parallel_for(std::size_t{0}, attempts.size(), [&](std::size_t k) {
    Worker& worker = workers.local();
    if (!worker.registrar) worker.registrar = std::make_unique<closure::Registrar>(rig, config);
    Attempt& t = attempts[k];
    frames.load(t.a, worker.a);
    if (worker.loaded != t.b) frames.load(t.b, worker.b);
    worker.loaded = t.b;
    const closure::Registration& found = worker.registrar->process(worker.a, worker.b, t.prior);
    t.refusal = found.refusal;
    t.link.a = t.a;
    t.link.b = t.b;
    t.link.T_a_b = found.T_a_b;
    t.link.covariance = found.covariance;
    t.link.inliers = static_cast<int>(found.inliers.size());
    progress.step();
  });
}

// A solution with what its graph knows, the stretches of the dive, and paths for each thread.
struct BatchClosureSearch::View {
  struct TreePaths {
    slam::TreePathCache places, poses;
    explicit TreePaths(const slam::GraphCovariance& known)
        : places(known, &slam::GraphCovariance::placePathOf, kPathBytes),
          poses(known, &slam::GraphCovariance::pathOf, kPathBytes) {}
  };

  View(const slam::NavigationSolution& given, slam::GraphCovariance&& graph, const StereoRig& rig,
       const Frames& frames)
      : solution(given), known(std::move(graph)), paths([this] { return TreePaths(known); }) {
    for (std::size_t k = 0; k < given.poses.size(); ++k)
      footprints.push_back(closure::footprintOf(given.poses[k], frames.range[k], rig.left));
    const auto separation = separationBy(paths.local());
    tree = std::make_unique<closure::StretchTree>(footprints, closure::stretchesOf(footprints, separation),
                                                  limits.min_overlap, separation);
    stretch_of.resize(footprints.size());
    for (std::uint32_t s = 0; s < tree->stretches().size(); ++s)
      for (std::uint32_t k = tree->stretches()[s].first; k < tree->stretches()[s].end; ++k) stretch_of[k] = s;
  }
  [[nodiscard]] closure::Separation separationBy(TreePaths& mine) const {
    return [this, &mine](std::uint32_t a, std::uint32_t b) -> Eigen::Matrix2d {
      return known.separation(mine.places.of(solution.nodes[a]), mine.places.of(solution.nodes[b]));
    };
  }
  [[nodiscard]] std::uint32_t middleOf(std::uint32_t frame) const {
    return tree->stretches()[stretch_of[frame]].middle();
  }
  // Of two frames, each as far as the middle of its stretch is known.
  [[nodiscard]] closure::RelativePrior between(std::uint32_t a, std::uint32_t b, TreePaths& mine) const {
    const auto& path_a = mine.poses.of(solution.nodes[middleOf(a)]);
    const auto& path_b = mine.poses.of(solution.nodes[middleOf(b)]);
    return {solution.poses[a].inverse() * solution.poses[b],
            known.between(path_a, path_b, solution.poses[b])};
  }
  // Calls visit(stretch, those before it in reach), in parallel, each stretch once.
  template <typename Visit>
  void forEachStretch(Visit visit) {
    tbb::parallel_for(
        tbb::blocked_range<std::uint32_t>(0, static_cast<std::uint32_t>(tree->stretches().size()), kGrain),
        [&](const tbb::blocked_range<std::uint32_t>& range) {
          const auto separation = separationBy(paths.local());
          std::vector<closure::StretchTree::Near> near;
          for (std::uint32_t s = range.begin(); s < range.end(); ++s) {
            tree->near(s, separation, near);
            visit(s, near);
          }
        },
        tbb::simple_partitioner());
  }

  const slam::NavigationSolution& solution;
  slam::GraphCovariance known;
  tbb::enumerable_thread_specific<TreePaths> paths;
  closure::CandidateConfig limits;
  double apart = closure::separationOfOverlap(limits.min_overlap);
  std::vector<closure::Footprint> footprints;
  std::unique_ptr<closure::StretchTree> tree;
  std::vector<std::uint32_t> stretch_of;  // each frame
};

BatchClosureSearch::BatchClosureSearch(const StereoRig& rig, const Frames& frames, double visual_scale,
                                       const slam::RigPrior& open)
    : rig_(rig), frames_(frames), visual_scale_(visual_scale), open_(open) {}

BatchClosureSearch::~BatchClosureSearch() = default;

slam::GraphCovariance::ByShared BatchClosureSearch::sharedBy(const slam::NavigationLink& link) const {
  static_assert(slam::GraphCovariance::kShared == closure::kCommonErrors);
  const Camera& camera = rig_.left;
  const Eigen::Vector2d half_view(0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy);
  const double range = frames_.range[link.b];
  return closure::poseBySharedErrors(sharedErrors(rig_, open_, half_view.x(), range), camera.fx,
                                     rig_.baseline(), half_view, range, link.T_a_b);
}

std::vector<slam::NavigationLink> BatchClosureSearch::straightened(std::vector<slam::NavigationLink> links,
                                                                   const Shared& by) const {
  if (by.isZero(0)) return links;
  for (slam::NavigationLink& link : links) link.T_a_b = link.T_a_b * SE3::exp(-(sharedBy(link) * by));
  return links;
}

double BatchClosureSearch::disparityError(const Shared& by, const Eigen::Vector2d& tangent) const {
  constexpr double kRange = 1;  // on which slopes and curves do not depend [m]
  const double half_view = 0.5 * rig_.left.width / rig_.left.fx;
  return closure::unevenDisparity(sharedErrors(rig_, open_, half_view, kRange), tangent) * by.tail<4>();
}

slam::GraphCovariance BatchClosureSearch::graphOf(const slam::NavigationSolution& solution,
                                                  const std::vector<slam::NavigationLink>& links,
                                                  const Shared& straightened_by) const {
  std::vector<slam::GraphCovariance::SharedByEdge> shared;
  for (const slam::NavigationLink& link : links)
    if (link.edge >= 0) shared.push_back({static_cast<std::size_t>(link.edge), sharedBy(link)});
  return slam::GraphCovariance(solution.graph, visual_scale_, solution.nodes, shared, straightened_by);
}

BatchClosureSearch::Shared BatchClosureSearch::estimate(const slam::NavigationSolution& solution,
                                                        const std::vector<slam::NavigationLink>& links,
                                                        const Shared& straightened_by) {
  view_.reset();  // one factor at a time
  return graphOf(solution, links, straightened_by).shared();
}

void BatchClosureSearch::look(const slam::NavigationSolution& solution,
                              const std::vector<slam::NavigationLink>& links, const Shared& straightened_by) {
  view_.reset();  // one factor at a time
  view_ = std::make_unique<View>(solution, graphOf(solution, links, straightened_by), rig_, frames_);
  std::vector<bool> linked(frames_.pair.size(), false);  // to the frame before
  for (const slam::NavigationLink& link : links)
    if (link.kept && link.ofChain()) linked[link.b] = true;
  older_end_.resize(linked.size());
  std::uint32_t chain = 0;  // the first frame that odometry links with this one
  for (std::uint32_t k = 0; k < linked.size(); ++k) {
    if (!linked[k]) chain = k;
    const auto back = [&](std::uint32_t frames) { return k > frames ? k - frames : 0; };
    older_end_[k] = std::max(back(kSkip - 1), std::min(chain, back(1)));
  }
}

const slam::GraphCovariance& BatchClosureSearch::known() const {
  return view_->known;
}

bool BatchClosureSearch::worthTrying(const closure::Candidate& c) const {
  if (c.information < view_->limits.min_information || c.value() < kLeastValue) return false;
  const auto before = tried_.find(keyOf(c.older, c.newer));
  if (before == tried_.end()) return true;
  if (before->second.accepted) return false;
  const std::vector<SE3>& poses = view_->solution.poses;
  const Vector6d moved = (before->second.T_a_b.inverse() * (poses[c.older].inverse() * poses[c.newer])).log();
  return moved.cwiseAbs2().cwiseQuotient(before->second.variance).sum() > kMovedAgain;
}

std::vector<closure::Candidate> BatchClosureSearch::proposed(std::size_t a_frame) {
  const std::vector<closure::Stretch>& stretches = view_->tree->stretches();
  std::vector<std::vector<closure::Candidate>> found(stretches.size());
  view_->forEachStretch([&](std::uint32_t s, const std::vector<closure::StretchTree::Near>& near) {
    std::vector<closure::Candidate> of_frame;
    for (std::uint32_t newer = stretches[s].first; newer < stretches[s].end; ++newer) {
      if (frames_.blank(newer)) continue;
      of_frame.clear();
      for (const closure::StretchTree::Near& n : near) {
        const closure::Stretch& there = stretches[n.stretch];
        for (std::uint32_t older = there.first; older < std::min(there.end, older_end_[newer]); ++older) {
          const closure::Candidate candidate =
              closure::candidateOf(older, view_->footprints[older], newer, view_->footprints[newer],
                                   n.covariance, view_->limits, view_->apart);
          if (worthTrying(candidate) && !frames_.blank(older)) of_frame.push_back(candidate);
        }
      }
      const std::size_t kept = std::min(a_frame, of_frame.size());
      std::partial_sort(of_frame.begin(), of_frame.begin() + static_cast<std::ptrdiff_t>(kept),
                        of_frame.end(), byWorth);
      found[s].insert(found[s].end(), of_frame.begin(), of_frame.begin() + static_cast<std::ptrdiff_t>(kept));
    }
  });
  std::vector<closure::Candidate> all;
  for (const auto& some : found) all.insert(all.end(), some.begin(), some.end());
  return all;
}

std::vector<Attempt> BatchClosureSearch::candidates(std::size_t most, std::size_t a_frame) {
  std::vector<closure::Candidate> all = proposed(a_frame);
  if (all.size() > most) {
    std::nth_element(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(most), all.end(), byWorth);
    all.resize(most);
  }
  std::sort(all.begin(), all.end(), byFrame);
  std::vector<Attempt> attempts(all.size());
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, all.size(), kGrain * kGrain),
      [&](const tbb::blocked_range<std::size_t>& range) {
        View::TreePaths& mine = view_->paths.local();
        for (std::size_t k = range.begin(); k < range.end(); ++k) {
          Attempt& t = attempts[k];
          t.a = all[k].older;
          t.b = all[k].newer;
          closure::RelativePrior prior = view_->between(t.a, t.b, mine);
          prior.covariance *= kPriorScale;
          prior.covariance.diagonal().head<3>().array() += kLeastSigma * kLeastSigma;
          prior.covariance.diagonal().tail<3>().array() += kLeastAngle * kLeastAngle;
          t.prior = prior;
        }
      },
      tbb::simple_partitioner());
  return attempts;
}

// Whether two closures of neighbouring frames agree around the cycle; the sides are short, so that what is
// known of them is odometry's.
bool BatchClosureSearch::confirmed(const Attempt& one, const Attempt& other) {
  View::TreePaths& mine = view_->paths.local();
  const auto side = [&](std::uint32_t from, std::uint32_t to) {
    closure::RelativePrior known = view_->between(from, to, mine);
    known.covariance.diagonal().array() += kLeastSigma * kLeastSigma / kPriorScale;
    return known;
  };
  return cycleDistance2({one.link.T_a_b, one.link.covariance}, side(one.b, other.b), side(one.a, other.a),
                        {other.link.T_a_b, other.link.covariance}) < kCycleGate;
}

std::vector<slam::NavigationLink> BatchClosureSearch::attempt(std::vector<Attempt>& attempts) {
  registerAll(rig_, frames_, {}, attempts, "closures");
  std::vector<slam::NavigationLink> links;
  for (const Attempt& t : attempts) {
    ++refused_[static_cast<std::size_t>(t.refusal)];
    tried_[keyOf(t.a, t.b)] = {t.prior->T_a_b, t.prior->covariance.diagonal(), t.accepted()};
    if (!t.accepted()) continue;
    const double sigma = std::sqrt(t.prior->covariance.diagonal().head<3>().maxCoeff() / kPriorScale);
    if (sigma <= kWide * view_->footprints[t.b].radius)
      links.push_back(t.link);
    else
      waiting_.push_back(t);
  }
  // By frame, so that those that may confirm each other are near each other.
  std::sort(waiting_.begin(), waiting_.end(),
            [](const Attempt& x, const Attempt& y) { return std::tie(x.b, x.a) < std::tie(y.b, y.a); });
  std::vector<bool> sure(waiting_.size(), false);
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    for (std::size_t j = i + 1; j < waiting_.size() && waiting_[j].b <= waiting_[i].b + kNeighbours; ++j) {
      const std::uint32_t a = waiting_[i].a, other = waiting_[j].a;
      const std::uint32_t apart = std::max(a, other) - std::min(a, other);
      if (apart == 0 || apart > kNeighbours || waiting_[i].b == waiting_[j].b || (sure[i] && sure[j]))
        continue;
      if (confirmed(waiting_[i], waiting_[j])) sure[i] = sure[j] = true;
    }
  }
  std::vector<Attempt> still;
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    if (sure[i])
      links.push_back(waiting_[i].link);
    else
      still.push_back(waiting_[i]);
  }
  waiting_ = std::move(still);
  view_.reset();
  return links;
}

// A stretch is expected to cross earlier track by the number of frames that its middle overlaps in
// probability, over the number that it would overlap where one line passes below it.
Crossings BatchClosureSearch::crossings(const std::vector<slam::NavigationLink>& links) {
  const std::vector<closure::Stretch>& stretches = view_->tree->stretches();
  const std::vector<closure::Footprint>& footprints = view_->footprints;
  const auto away = [&](std::uint32_t a, std::uint32_t b) {
    return frames_.travelled[b] - frames_.travelled[a] > kAway * footprints[b].radius;
  };
  std::vector<bool> closed(footprints.size(), false);
  for (const slam::NavigationLink& link : links)
    if (link.kept && away(link.a, link.b)) closed[link.b] = true;
  std::vector<Crossings> of_stretch(stretches.size());
  view_->forEachStretch([&](std::uint32_t s, const std::vector<closure::StretchTree::Near>& near) {
    const std::uint32_t here = stretches[s].middle();
    double share = 0;
    for (const closure::StretchTree::Near& n : near) {
      for (std::uint32_t k = std::max(stretches[n.stretch].first, 1U); k < stretches[n.stretch].end; ++k) {
        if (!away(k, here)) continue;
        const double step = frames_.travelled[k] - frames_.travelled[k - 1];
        const closure::Candidate c = closure::candidateOf(k, footprints[k], here, footprints[here],
                                                          n.covariance, view_->limits, view_->apart);
        share += c.probability * step / (2 * view_->apart * footprints[here].radius);
      }
    }
    const std::uint32_t first = stretches[s].first, end = stretches[s].end;
    Crossings& mine = of_stretch[s];
    mine.expected =
        std::min(share, 1.0) * (frames_.travelled[end - 1] - frames_.travelled[first > 0 ? first - 1 : 0]);
    const auto from = closed.begin() + (first > kNeighbours ? first - kNeighbours : 0);
    const auto to = closed.begin() + std::min<std::ptrdiff_t>(end + kNeighbours, std::ssize(closed));
    if (std::find(from, to, true) == to) mine.unverified = mine.expected;
  });
  Crossings sum;
  for (const Crossings& c : of_stretch) {
    sum.expected += c.expected;
    sum.unverified += c.unverified;
  }
  return sum;
}

}  // namespace fathom::topside

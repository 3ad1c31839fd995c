#include "recon/topside/localise/free_poses.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "realtime/base/numbers/union_find.hpp"
#include "recon/closure/candidates.hpp"
#include "recon/closure/place_index.hpp"
#include "recon/closure/recognition.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"
#include "recon/solver/batch/batch_solver.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/control_network.hpp"
#include "recon/topside/localise/ground_steps.hpp"
#include "recon/topside/localise/known_places.hpp"
#include "recon/topside/localise/visual_odometry.hpp"
#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kOverlapRounds = 2;  // of overlaps: each says where the next one looks
constexpr std::size_t kPlaceTries = 4;     // places that a pair is compared with
constexpr double kMaxChi2 = 22.46;         // of a closure, 99.9 % of chi-square with 6 degrees of freedom
constexpr double kGap = 2;                 // between parts [m]
constexpr double kNearCentres = 0.7;       // of two footprints' centres, in radii, that overlap well
// Of two poses that odometry joins: at best, and growing with the distance.
constexpr double kOdometrySigma = 0.05, kOdometryAngle = 0.03, kOdometryDrift = 0.03;  // [m], [rad], [1]

class FreePoses {
 public:
  FreePoses(const MissionInput& input, const Survey& survey, const FeatureStore& features)
      : input_(input), rig_(input.rig), survey_(survey), places_(framesOf(features)) {
    poses_.resize(frames_.pair.size());
    frames_.travelled.assign(frames_.pair.size(), 0);
  }

  [[nodiscard]] const Frames& frames() const { return frames_; }
  [[nodiscard]] const std::vector<SE3>& poses() const { return poses_; }
  [[nodiscard]] const std::vector<slam::NavigationLink>& links() const { return links_; }
  [[nodiscard]] std::size_t odometryLinks() const { return odometry_; }
  [[nodiscard]] const KnownPlaces& places() const { return places_; }
  // Frames that links join, by their first.
  struct Part {
    std::vector<std::uint32_t> frames;
    bool placed = false;  // navigation or control points say where
  };
  std::vector<SlamResult::Tried> tried;
  std::array<std::size_t, closure::kRefusals> refused{};
  bool converged = true;
  std::map<std::uint32_t, closure::Refusal> broken;  // frames that nothing joins to the one before

  void odometry() {
    std::vector<Attempt> steps = attemptsOf(stepsOver(1, {}));
    registerAll(rig_, frames_, stepRules(), steps, "odometry");
    for (const Attempt& t : steps)
      if (t.accepted())
        links_.push_back(t.link);
      else
        broken[t.b] = t.refusal;
    std::vector<Attempt> over = attemptsOf(stepsOver(2, broken));
    registerAll(rig_, frames_, stepRules(), over, "odometry over one");
    for (const Attempt& t : over)
      if (t.accepted()) links_.push_back(t.link);
    if (!input_.features_only) {
      std::vector<std::uint32_t> bare;
      for (const auto& [b, why] : broken) bare.push_back(b);
      for (const slam::NavigationLink& link : groundSteps(input_, survey_, frames_, bare)) {
        links_.push_back(link);
        broken.erase(link.b);
      }
    }
    for (auto step = broken.begin(); step != broken.end();)
      if (const auto link = places_.stepTo(step->first)) {
        links_.push_back(*link);
        step = broken.erase(step);
      } else {
        ++step;
      }
    odometry_ = links_.size();
    solve();
  }

  // Frames that look like others, wherever they are.
  void recognise() {
    std::vector<Attempt> attempts = attemptsOf(alike());
    registerAll(rig_, frames_, closure::recognitionRules(), attempts, "recognition");
    closure::Agreement agreement;
    const auto odometry = [&](int x, int y) { return between(x, y); };
    for (const Attempt& t : attempts) {
      note(t);
      if (!t.accepted()) continue;
      const double radius = footprint(t.b).radius;
      const closure::Claim claim =
          closure::recognitionOf(static_cast<int>(t.a), static_cast<int>(t.b),
                                 {t.link.T_a_b, t.link.covariance}, t.link.inliers, radius);
      for (const closure::Claim& sure : agreement.add(claim, odometry)) links_.push_back(linkOf(sure));
    }
    solve();
  }

  // Frames that overlap where they are now. False: no new link.
  bool overlaps(std::size_t a_frame) {
    std::vector<Attempt> attempts = attemptsOf(overlapping(a_frame));
    for (Attempt& t : attempts) t.prior = overlapPrior(t.a, t.b);
    registerAll(rig_, frames_, {}, attempts, "closures");
    const std::size_t before = links_.size();
    for (const Attempt& t : attempts) {
      note(t);
      if (t.accepted()) links_.push_back(t.link);
    }
    if (links_.size() == before) return false;
    solve();
    return true;
  }

  SlamResult::Bundled bundled(const TopsideConfig& config, const GreyImages& images) {
    return topside::bundled(rig_, config, survey_, frames_, images, links_, poses_, [&] { solve(); });
  }

  // Brings arranged parts to control points, at the scale that these, and bars, tell.
  ControlResult hold(ControlNetwork& control, std::vector<Part>& parts, double scale_sigma) {
    std::vector<std::vector<std::uint32_t>> frames;
    for (const Part& part : parts) frames.push_back(part.frames);
    const double scale = control.scaleAt(frames, poses_);
    for (Part& part : parts) {
      for (const std::uint32_t k : part.frames) poses_[k] = grown(poses_[k], scale);
      const auto motion = control.motionOf(part.frames, poses_, !places_.any());
      if (!motion) continue;
      for (const std::uint32_t k : part.frames) poses_[k] = *motion * poses_[k];
      part.placed = true;
    }
    KnownPlaces::Placed network = placed(parts);
    ControlNetwork::Solved solved{&network.graph, {}, 0, {}, scale_sigma, scale};
    for (std::size_t k = 0; k < poses_.size(); ++k) solved.nodes.push_back(static_cast<int>(k) + 1);
    const auto kept = std::count_if(links_.begin(), links_.end(), [](const auto& link) { return link.kept; });
    for (std::ptrdiff_t k = 0; k < kept; ++k) solved.visual.push_back(static_cast<std::size_t>(k));
    ControlResult out = control.adjust(solved);
    converged = out.converged;
    takePoses(network.graph);
    standApart(parts);
    for (slam::NavigationLink& link : links_) link.T_a_b = grown(link.T_a_b, out.scale);
    return out;
  }

  // Their frames' poses are level afterwards: where navigation has them, the others beside, east of all.
  std::vector<Part> arrange() {
    std::map<std::uint32_t, Part> by_root;
    for (std::uint32_t k = 0; k < poses_.size(); ++k) by_root[parts_.root(k)].frames.push_back(k);
    std::vector<Part> parts;
    for (auto& [root, part] : by_root) {
      const KnownPlaces::Motion motion = places_.motionOf(part.frames, poses_);
      for (const std::uint32_t k : part.frames) poses_[k] = motion.T_nav_part * poses_[k];
      part.placed = motion.placed;
      parts.push_back(std::move(part));
    }
    if (places_.any()) (void)placed(parts);
    standApart(parts);
    return parts;
  }
  // Those that are nowhere, east of the others.
  void standApart(const std::vector<Part>& parts) {
    std::optional<double> east;
    for (const bool placed : {true, false})
      for (const Part& part : parts)
        if (part.placed == placed) east = standAside(part, east);
  }

 private:
  // Frames are the pairs that show something.
  KnownPlaces framesOf(const FeatureStore& features) {
    frames_.features = &features;
    std::vector<KnownPose> known;
    std::vector<Eigen::Vector3d> ground;
    for (std::uint32_t k = 0; k < survey_.planes.size(); ++k) {
      if (features.count(k) == 0 || !survey_.planes[k]) continue;
      known.push_back(survey_.known.empty() ? KnownPose() : survey_.known[k]);
      if (!frames_.pair.empty() && frames_.pair.back() + 1 != k) known.back().moved.reset();
      frames_.pair.push_back(k);
      frames_.range.push_back(survey_.planes[k]->ahead());
      ground.push_back(survey_.planes[k]->normal);
    }
    return {std::move(known), std::move(ground), input_.mission.T_body_cam, input_.mounted};
  }

  // The part's eastern edge, once one that is nowhere stands east of that of those before it.
  double standAside(const Part& part, std::optional<double> edge) {
    double low = INFINITY, high = -INFINITY;
    for (const std::uint32_t k : part.frames) {
      const closure::Footprint f = footprint(k);
      low = std::min(low, f.centre.y() - f.radius);
      high = std::max(high, f.centre.y() + f.radius);
    }
    if (part.placed || !edge) return std::max(high, edge.value_or(high));
    const SE3 aside(Eigen::Quaterniond::Identity(), {0, *edge + kGap - low, 0});
    for (const std::uint32_t k : part.frames) poses_[k] = aside * poses_[k];
    return high + *edge + kGap - low;
  }

  // The network of arranged parts in nav, solved with what navigation says.
  KnownPlaces::Placed placed(const std::vector<Part>& parts) {
    std::vector<std::uint32_t> firsts;
    for (const Part& part : parts) firsts.push_back(part.frames.front());
    KnownPlaces::Placed out = places_.improved(linked(), firsts);
    converged = out.converged;
    takePoses(out.graph);
    return out;
  }
  void takePoses(const slam::PoseGraph& in_nav) {
    std::copy_n(in_nav.poses.begin() + 1, poses_.size(), poses_.begin());
  }

  // Of the links that are kept.
  slam::PoseGraph linked() const {
    slam::PoseGraph graph;
    graph.poses = poses_;
    for (std::size_t k = 0; k < poses_.size(); ++k) graph.ids.push_back(static_cast<std::int64_t>(k));
    for (const slam::NavigationLink& link : links_)
      if (link.kept)
        graph.edges.push_back(slam::linkFactor(static_cast<int>(link.a), static_cast<int>(link.b), link.T_a_b,
                                               link.covariance));
    return graph;
  }

  void note(const Attempt& t) {
    tried.push_back({frames_.pair[t.a], frames_.pair[t.b], t.accepted()});
    ++refused[static_cast<std::size_t>(t.refusal)];
    known_.insert({t.a, t.b});
  }

  // All frames with the one `step` before; with `only`, about those.
  [[nodiscard]] FramePairs stepsOver(std::uint32_t step,
                                     const std::map<std::uint32_t, closure::Refusal>& only) {
    FramePairs pairs;
    for (std::uint32_t b = step; b < frames_.pair.size(); ++b)
      if (only.empty() ? step == 1 : only.contains(b) || only.contains(b - 1))
        pairs.emplace_back(b - step, b);
    for (const auto& pair : pairs) known_.insert(pair);
    return pairs;
  }

  [[nodiscard]] FramePairs alike() const {
    closure::PlaceIndexConfig config;
    config.max_places = static_cast<int>(std::max<std::size_t>(frames_.pair.size(), 1));
    closure::PlaceIndex places(config);
    closure::FrameFeatures features;
    FramePairs pairs;
    for (std::uint32_t k = 0; k < frames_.pair.size(); ++k) {
      frames_.load(k, features);
      const auto wanted = [&](int id) {
        const auto other = static_cast<std::uint32_t>(id);
        return !known_.contains({other, k}) && mayBeNear(other, k);
      };
      for (const auto& place : places.query(features, kPlaceTries, wanted))
        pairs.emplace_back(static_cast<std::uint32_t>(place.id), k);
      (void)places.add(static_cast<int>(k), features);
    }
    return pairs;
  }

  // The nearest ones of each frame among the older, in cells of the ground.
  [[nodiscard]] FramePairs overlapping(std::size_t a_frame) {
    (void)arrange();
    std::map<std::pair<int, int>, std::vector<std::uint32_t>> cells;
    double edge = 0;
    for (std::uint32_t k = 0; k < poses_.size(); ++k) edge = std::max(edge, footprint(k).radius);
    const auto cellOf = [&](const Eigen::Vector2d& p) {
      return std::pair(static_cast<int>(std::floor(p.x() / edge)),
                       static_cast<int>(std::floor(p.y() / edge)));
    };
    FramePairs pairs;
    for (std::uint32_t b = 0; b < poses_.size(); ++b) {
      const closure::Footprint here = footprint(b);
      const auto [x, y] = cellOf(here.centre);
      std::vector<std::pair<double, std::uint32_t>> near;
      for (int dx = -1; dx <= 1; ++dx)
        for (int dy = -1; dy <= 1; ++dy)
          if (const auto cell = cells.find({x + dx, y + dy}); cell != cells.end())
            for (const std::uint32_t a : cell->second) {
              const closure::Footprint there = footprint(a);
              const double apart = (there.centre - here.centre).norm();
              if (apart < kNearCentres * (there.radius + here.radius) && !known_.contains({a, b}) &&
                  overlapPrior(a, b))
                near.emplace_back(apart, a);
            }
      std::sort(near.begin(), near.end());
      for (std::size_t k = 0; k < std::min(a_frame, near.size()); ++k) pairs.emplace_back(near[k].second, b);
      cells[{x, y}].push_back(b);
    }
    return pairs;
  }

  [[nodiscard]] closure::Footprint footprint(std::uint32_t frame) const {
    return closure::footprintOf(poses_[frame], frames_.range[frame], rig_.left);
  }

  // False: positions have them too far from each other to show the same ground.
  bool mayBeNear(std::uint32_t a, std::uint32_t b) const {
    constexpr double kSigmas = 4;
    const auto apart = places_.apart(a, b);
    return !apart || apart->distance < kSigmas * apart->sigma + 2 * (frames_.range[a] + frames_.range[b]);
  }

  // What is known of b seen from a; of another part, what positions say, if that leaves no room for places
  // that look alike.
  std::optional<closure::RelativePrior> overlapPrior(std::uint32_t a, std::uint32_t b) {
    if (parts_.root(a) == parts_.root(b)) return between(static_cast<int>(a), static_cast<int>(b));
    constexpr double kTurn = 0.15;  // of compasses [rad]
    const auto apart = places_.apart(a, b);
    if (!apart || apart->sigma > footprint(b).radius) return {};
    return closure::RelativePrior{poses_[a].inverse() * poses_[b], covarianceOf(apart->sigma, kTurn)};
  }

  // What is known of y seen from x; of another part: nothing that anything could agree with.
  closure::RelativePrior between(int x, int y) {
    const auto a = static_cast<std::uint32_t>(x), b = static_cast<std::uint32_t>(y);
    if (parts_.root(a) != parts_.root(b))
      return {SE3(Eigen::Quaterniond::Identity(), {1e6, 0, 0}), covarianceOf(kOdometrySigma, kOdometryAngle)};
    const double sigma =
        kOdometrySigma + kOdometryDrift * std::abs(frames_.travelled[b] - frames_.travelled[a]);
    return {poses_[a].inverse() * poses_[b], covarianceOf(sigma, kOdometryAngle * sigma / kOdometrySigma)};
  }

  // Closures that contradict too much are taken out, those that contradict most first.
  void solve() {
    constexpr double kNearWorst = 0.5;
    for (bool again = true; again;) {
      again = false;
      parts_.reset(poses_.size());
      slam::PoseGraph graph = linked();
      std::vector<slam::NavigationLink*> edges;
      for (slam::NavigationLink& link : links_) {
        if (!link.kept) continue;
        parts_.join(link.a, link.b);
        edges.push_back(&link);
      }
      if (edges.empty()) return;
      converged = slam::optimize(graph, {}).converged;
      poses_ = graph.poses;
      double most = 0;
      for (std::size_t e = 0; e < edges.size(); ++e) {
        slam::NavigationLink& link = *edges[e];
        const Vector6d error = slam::relativePoseError(graph.edges[e], poses_[link.a], poses_[link.b]);
        link.chi2 = error.dot(graph.edges[e].information * error);
        if (!link.ofChain()) most = std::max(most, link.chi2);
      }
      for (slam::NavigationLink* link : edges)
        if (!link->ofChain() && link->chi2 > std::max(kMaxChi2, kNearWorst * most)) {
          link->kept = false;
          again = true;
        }
    }
    for (std::uint32_t k = 1; k < poses_.size(); ++k) {
      const bool joined = parts_.root(k - 1) == parts_.root(k);
      frames_.travelled[k] = frames_.travelled[k - 1] +
                             (joined ? (poses_[k].translation() - poses_[k - 1].translation()).norm() : 0);
    }
  }

  const MissionInput& input_;
  const StereoRig& rig_;
  const Survey& survey_;
  Frames frames_;
  KnownPlaces places_;
  std::vector<SE3> poses_;
  std::vector<slam::NavigationLink> links_;  // by frame; odometry first
  std::size_t odometry_ = 0;
  UnionFind parts_;
  std::set<FramePairs::value_type> known_;  // tried
};

}  // namespace

SlamResult localiseFreely(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                          const FeatureStore& features, const GreyImages& images) {
  SlamResult out;
  out.poses = survey.navigation.poses;
  Stopwatch watch;
  FreePoses free(input, survey, features);
  const Frames& frames = free.frames();
  out.frames = frames.pair.size();
  free.odometry();
  out.seconds["odometry"] = watch.lap();
  free.recognise();
  out.seconds["places"] = watch.lap();
  const auto a_frame = static_cast<std::size_t>(config.slam_candidates);
  for (std::size_t round = 0; round < kOverlapRounds && free.overlaps(a_frame); ++round) continue;
  out.seconds["closures"] = watch.lap();
  out.bundled = free.bundled(config, images);
  out.seconds["bundle"] = watch.lap();
  std::vector<FreePoses::Part> parts = free.arrange();
  if (input.control) {
    ControlNetwork control(*input.control, sightingsOf(*input.control, survey.list), input.rig, frames);
    out.control = free.hold(control, parts, config.navigation.rig.scale);
    out.seconds["control"] = watch.lap();
  }
  for (const auto& [members, placed] : parts) {
    SlamResult::Part& part = out.parts.emplace_back();
    part.placed = placed;
    for (const std::uint32_t k : members) part.pairs.push_back(frames.pair[k]);
    const auto broken = free.broken.find(members.front());
    if (broken != free.broken.end()) part.why = broken->second;
  }
  out.fixes_kept = free.places().positionsKept();
  out.fixes_removed = free.places().positionsLeftOut();
  out.refused_tilt = free.places().refusedTilt();
  const SE3 T_cam_body = input.mission.T_body_cam.inverse();
  for (std::size_t k = 0; k < frames.pair.size(); ++k)
    out.poses[frames.pair[k]].T_nav_body = free.poses()[k] * T_cam_body;
  for (std::size_t k = 0; k < free.links().size(); ++k) {
    slam::NavigationLink link = free.links()[k];
    link.a = frames.pair[link.a];
    link.b = frames.pair[link.b];
    (k < free.odometryLinks() ? out.odometry : out.closures).push_back(link);
  }
  out.converged = free.converged;
  out.tried = free.tried;
  out.refused = free.refused;
  return out;
}

}  // namespace fathom::topside

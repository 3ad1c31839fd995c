#include "recon/topside/localise/free_network.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "recon/closure/place_index.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/first_links.hpp"
#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kOverlapRounds = 2;  // of overlaps: each says where the next one looks
constexpr std::size_t kPlaceTries = 4;     // places that a pair is compared with
constexpr double kNearCentres = 0.7;       // of two footprints' centres, in radii, that overlap well
// Of two poses that odometry joins: at best, and growing with the distance.
constexpr double kOdometrySigma = 0.05, kOdometryAngle = 0.03, kOdometryDrift = 0.03;  // [m], [rad], [1]

// Finds the links of a free network: steps, places that look alike, overlaps.
class LinkSearch {
 public:
  LinkSearch(const MissionInput& input, const Survey& survey, FreeNetwork& network)
      : input_(input), survey_(survey), network_(network) {}

  [[nodiscard]] std::size_t odometryLinks() const { return odometry_; }
  std::vector<SlamResult::Tried> tried;
  std::array<std::size_t, closure::kRefusals> refused{};
  std::map<std::uint32_t, closure::Refusal> broken;  // frames that nothing joins to the one before

  void odometry() {
    std::vector<Attempt> steps = attemptsOf(stepsOver(1, {}));
    registerAll(input_.rig, frames_, stepRules(), steps, "odometry");
    for (const Attempt& t : steps)
      if (t.accepted())
        network_.links.push_back(t.link);
      else
        broken[t.b] = t.refusal;
    std::vector<Attempt> over = attemptsOf(stepsOver(2, broken));
    registerAll(input_.rig, frames_, stepRules(), over, "odometry over one");
    for (const Attempt& t : over)
      if (t.accepted()) network_.links.push_back(t.link);
    if (!input_.features_only) {
      std::vector<std::uint32_t> bare;
      for (const auto& [b, why] : broken) bare.push_back(b);
      for (const slam::NavigationLink& link : groundSteps(input_, survey_, frames_, bare, false)) {
        network_.links.push_back(link);
        broken.erase(link.b);
      }
    }
    for (auto step = broken.begin(); step != broken.end();)
      if (const auto link = network_.places().stepTo(step->first)) {
        network_.links.push_back(*link);
        step = broken.erase(step);
      } else {
        ++step;
      }
    odometry_ = network_.links.size();
    network_.solve();
  }

  // Frames that look like others, wherever they are.
  void recognise() {
    std::vector<Attempt> attempts = attemptsOf(alike());
    registerAll(input_.rig, frames_, closure::recognitionRules(), attempts, "recognition");
    closure::Agreement agreement;
    const auto odometry = [&](int x, int y) { return between(x, y); };
    for (const Attempt& t : attempts) {
      note(t);
      if (!t.accepted()) continue;
      const double radius = network_.footprint(t.b).radius;
      const closure::Claim claim =
          closure::recognitionOf(static_cast<int>(t.a), static_cast<int>(t.b),
                                 {t.link.T_a_b, t.link.covariance}, t.link.inliers, radius);
      for (const closure::Claim& sure : agreement.add(claim, odometry))
        network_.links.push_back(linkOf(sure));
    }
    network_.solve();
  }

  // Frames that overlap where they are now. False: no new link.
  bool overlaps(std::size_t a_frame) {
    std::vector<Attempt> attempts = attemptsOf(overlapping(a_frame));
    for (Attempt& t : attempts) t.prior = overlapPrior(t.a, t.b);
    registerAll(input_.rig, frames_, {}, attempts, "closures");
    const std::size_t before = network_.links.size();
    for (const Attempt& t : attempts) {
      note(t);
      if (t.accepted()) network_.links.push_back(t.link);
    }
    if (network_.links.size() == before) return false;
    network_.solve();
    return true;
  }

 private:
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
    (void)network_.arrange();
    std::map<std::pair<int, int>, std::vector<std::uint32_t>> cells;
    double edge = 0;
    for (std::uint32_t k = 0; k < network_.poses().size(); ++k)
      edge = std::max(edge, network_.footprint(k).radius);
    const auto cellOf = [&](const Eigen::Vector2d& p) {
      return std::pair(static_cast<int>(std::floor(p.x() / edge)),
                       static_cast<int>(std::floor(p.y() / edge)));
    };
    FramePairs pairs;
    for (std::uint32_t b = 0; b < network_.poses().size(); ++b) {
      const closure::Footprint here = network_.footprint(b);
      const auto [x, y] = cellOf(here.centre);
      std::vector<std::pair<double, std::uint32_t>> near;
      for (int dx = -1; dx <= 1; ++dx)
        for (int dy = -1; dy <= 1; ++dy)
          if (const auto cell = cells.find({x + dx, y + dy}); cell != cells.end())
            for (const std::uint32_t a : cell->second) {
              const closure::Footprint there = network_.footprint(a);
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

  // False: positions have them too far from each other to show the same ground.
  bool mayBeNear(std::uint32_t a, std::uint32_t b) const {
    constexpr double kSigmas = 4;
    const auto apart = network_.places().apart(a, b);
    return !apart || apart->distance < kSigmas * apart->sigma + 2 * (frames_.range[a] + frames_.range[b]);
  }

  // What is known of b seen from a; of another part, what positions say, if that leaves no room for places
  // that look alike.
  std::optional<closure::RelativePrior> overlapPrior(std::uint32_t a, std::uint32_t b) {
    if (network_.inOnePart(a, b)) return between(static_cast<int>(a), static_cast<int>(b));
    constexpr double kTurn = 0.15;  // of compasses [rad]
    const auto apart = network_.places().apart(a, b);
    if (!apart || apart->sigma > network_.footprint(b).radius) return {};
    return closure::RelativePrior{network_.poses()[a].inverse() * network_.poses()[b],
                                  covarianceOf(apart->sigma, kTurn)};
  }

  // What is known of y seen from x; of another part: nothing that anything could agree with.
  closure::RelativePrior between(int x, int y) {
    const auto a = static_cast<std::uint32_t>(x), b = static_cast<std::uint32_t>(y);
    if (!network_.inOnePart(a, b))
      return {SE3(Eigen::Quaterniond::Identity(), {1e6, 0, 0}), covarianceOf(kOdometrySigma, kOdometryAngle)};
    const double sigma =
        kOdometrySigma + kOdometryDrift * std::abs(frames_.travelled[b] - frames_.travelled[a]);
    return {network_.poses()[a].inverse() * network_.poses()[b],
            covarianceOf(sigma, kOdometryAngle * sigma / kOdometrySigma)};
  }

  const MissionInput& input_;
  const Survey& survey_;
  FreeNetwork& network_;
  const Frames& frames_ = network_.frames();
  std::size_t odometry_ = 0;
  std::set<FramePairs::value_type> known_;  // tried
};

}  // namespace

SlamResult localiseFreely(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                          const FeatureStore& features, const GreyImages& images) {
  SlamResult out;
  out.poses = survey.navigation.poses;
  Stopwatch watch;
  FreeNetwork network(input, survey, features);
  LinkSearch search(input, survey, network);
  const Frames& frames = network.frames();
  out.frames = frames.pair.size();
  search.odometry();
  out.seconds["odometry"] = watch.lap();
  search.recognise();
  out.seconds["places"] = watch.lap();
  const auto a_frame = static_cast<std::size_t>(config.slam_candidates);
  for (std::size_t round = 0; round < kOverlapRounds && search.overlaps(a_frame); ++round) continue;
  out.seconds["closures"] = watch.lap();
  out.bundled = bundled(input.rig, config, survey, frames, images, network.links, network.poses(),
                        [&] { network.solve(); });
  out.seconds["bundle"] = watch.lap();
  std::vector<FreeNetwork::Part> parts = network.arrange();
  if (input.control) {
    ControlNetwork control(*input.control, sightingsOf(*input.control, survey.list), input.rig, frames);
    out.control = network.hold(control, parts, config.navigation.rig.scale);
    out.seconds["control"] = watch.lap();
  }
  for (const auto& [members, placed] : parts) {
    SlamResult::Part& part = out.parts.emplace_back();
    part.placed = placed;
    for (const std::uint32_t k : members) part.pairs.push_back(frames.pair[k]);
    const auto broken = search.broken.find(members.front());
    if (broken != search.broken.end()) part.why = broken->second;
  }
  out.fixes_kept = network.places().positionsKept();
  out.fixes_removed = network.places().positionsLeftOut();
  out.refused_tilt = network.places().refusedTilt();
  const SE3 T_cam_body = input.mission.T_body_cam.inverse();
  for (std::size_t k = 0; k < frames.pair.size(); ++k)
    out.poses[frames.pair[k]].T_nav_body = network.poses()[k] * T_cam_body;
  for (std::size_t k = 0; k < network.links.size(); ++k) {
    slam::NavigationLink link = network.links[k];
    link.a = frames.pair[link.a];
    link.b = frames.pair[link.b];
    (k < search.odometryLinks() ? out.odometry : out.closures).push_back(link);
  }
  out.converged = network.converged();
  out.tried = search.tried;
  out.refused = search.refused;
  return out;
}

}  // namespace fathom::topside

#include "recon/navigation/graph/navigation_batch.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"
#include "recon/solver/batch/batch_solver.hpp"

namespace fathom::slam {
namespace {

constexpr int kWeightRounds = 40;  // of weights, at most: from a false closure of 10 km they take 20
constexpr int kOrigin = 0;         // nav's origin in the graph
constexpr int kSpareRoom = 16;     // beyond the input
// Quantiles and the values that a normal distribution has there: of changes from one reading's error to the
// next's; of distances of USBL positions, in standard deviations of either component.
constexpr double kMostChanges = 0.9, kOfChanges = 1.645 * std::numbers::sqrt2;
constexpr double kAgreeing = 0.75, kOfAgreeing = 1.665;

double chiSquareOf(const RelativePose& edge, const std::vector<SE3>& poses) {
  const Vector6d error = relativePoseError(edge, poses[at(edge.from)], poses[at(edge.to)]);
  return error.dot(edge.information * error);
}

// Outlier gating and robust weights of closures and fixes: truncated least squares by graduated non-convexity
// (Yang, Antonante, Tzoumas & Carlone 2020). The cost of a factor is min(chi2, gate), approached from the
// convex side, so that weights do not depend on the factor that happens to fit worst beside an outlier.
class RobustBatch {
 public:
  RobustBatch(const NavigationConfig& config, const std::vector<KeyframeInput>& frames,
              const NavigationSolution& start, std::vector<NavigationLink>& links,
              std::vector<NavigationFix>& fixes)
      : config_(config),
        frames_(frames),
        nodes_(start.nodes),
        usbl_(start.usbl_node),
        T_nav_usbl_(start.T_nav_usbl),
        links_(links),
        fixes_(fixes) {
    for (NavigationLink& link : links)
      if (!link.ofChain()) closures_.push_back(&link);
    for (NavigationLink* link : closures_) link->weight = 1;
    fix_weights_.assign(fixes.size(), 1);
  }

  void append(const std::vector<SE3>& poses, std::vector<RelativePose>& edges) const {
    const auto add = [&](RelativePose edge, double weight) {
      if (weight == 0) return -1;
      edge.information *= weight;
      edges.push_back(edge);
      return static_cast<int>(edges.size()) - 1;
    };
    for (NavigationLink& link : links_) link.edge = add(edgeOf(link), link.weight);
    for (std::size_t i = 0; i < fixes_.size(); ++i) (void)add(edgeOf(fixes_[i], poses), fix_weights_[i]);
  }

  // Weights at `poses` for the next shape; false when they no longer change.
  bool weigh(const std::vector<SE3>& poses) {
    double worst = 0;
    measure(poses);
    for (const NavigationLink* link : closures_) worst = std::max(worst, link->chi2 / gateOf(*link));
    for (const NavigationFix& fix : fixes_) worst = std::max(worst, fix.chi2 / config_.fix_gate);
    shape_ = shape_ > 0 ? kSteeper * shape_ : 1 / std::max(2 * worst - 1, 1.0);
    bool changed = false;
    const auto set = [&](double& weight, double share) {
      const double now = share >= (shape_ + 1) / shape_   ? 0
                         : share <= shape_ / (shape_ + 1) ? 1
                                                          : std::sqrt(shape_ * (shape_ + 1) / share) - shape_;
      changed = changed || std::abs(now - weight) > kSameWeight;
      weight = now;
    };
    for (NavigationLink* link : closures_) set(link->weight, link->chi2 / gateOf(*link));
    for (std::size_t i = 0; i < fixes_.size(); ++i) set(fix_weights_[i], fixes_[i].chi2 / config_.fix_gate);
    return changed || shape_ < kSteepest;
  }

  void judge(const std::vector<SE3>& poses) {
    measure(poses);
    for (NavigationLink* link : closures_) link->kept = link->weight > kKept;
    for (std::size_t i = 0; i < fixes_.size(); ++i) fixes_[i].kept = fix_weights_[i] > kKept;
  }

 private:
  static constexpr double kSteeper = 4, kSteepest = 100;  // of the shape mu, a round; where it is truncation
  static constexpr double kSameWeight = 0.01, kKept = 0.5;  // [1]

  // A closure of few features is false more often than one of many, and says less where it is right.
  [[nodiscard]] double gateOf(const NavigationLink& link) const {
    constexpr int kFew = 40;
    constexpr double kShare = 0.28;  // 99.9 % become 60 % of chi-square with 6 degrees of freedom
    return (link.inliers < kFew ? kShare : 1) * config_.gate;
  }
  void measure(const std::vector<SE3>& poses) {
    for (NavigationLink& link : links_) link.chi2 = chiSquareOf(edgeOf(link), poses);
    for (NavigationFix& fix : fixes_) fix.chi2 = chiSquareOf(edgeOf(fix, poses), poses);
  }
  RelativePose edgeOf(const NavigationLink& link) const {
    return linkFactor(nodes_[link.a], nodes_[link.b], link.T_a_b, link.covariance);
  }
  RelativePose edgeOf(const NavigationFix& fix, const std::vector<SE3>& poses) const {
    const int node = nodes_[at(fix.frame)];
    const SE3 &T_nav_cam = poses[at(node)], &T_odom_cam = frames_[at(fix.frame)].T_odom_cam;
    if (fix.by_usbl && usbl_ >= 0)
      return usblFixFactor(usbl_, node, T_nav_usbl_, poses[at(usbl_)], T_nav_cam, T_odom_cam,
                           fix.antenna_in_odom, fix.north_east, fix.sigma);
    return fixFactor(kOrigin, node, T_nav_cam, T_odom_cam, fix.antenna_in_odom, fix.north_east, fix.sigma);
  }

  const NavigationConfig& config_;
  const std::vector<KeyframeInput>& frames_;
  const std::vector<int>& nodes_;
  const int usbl_;  // pose of its positions' frame; -1: none
  const SE3 T_nav_usbl_;
  std::vector<NavigationLink>& links_;
  std::vector<NavigationLink*> closures_;  // of them
  std::vector<NavigationFix>& fixes_;
  std::vector<double> fix_weights_;
  double shape_ = 0;  // mu
};

double valueAt(std::span<double> values, double share) {
  return ranked(values, static_cast<std::size_t>(share * static_cast<double>(values.size() - 1)));
}

// A pose for what all USBL positions share: by their own standard deviation at least.
void addUsbl(const SensorNoise& noise, const std::vector<NavigationFix>& fixes, NavigationSolution& out) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  std::vector<double> sigmas;
  for (const NavigationFix& fix : fixes)
    if (fix.by_usbl) {
      sum += Eigen::Vector3d(fix.north_east.x(), fix.north_east.y(), 0);
      sigmas.push_back(fix.sigma);
    }
  if (sigmas.empty()) return;
  out.T_nav_usbl = SE3(Eigen::Quaterniond::Identity(), sum / static_cast<double>(sigmas.size()));
  out.usbl_node = static_cast<int>(out.graph.poses.size());
  out.graph.poses.push_back(out.T_nav_usbl);
  out.graph.edges.push_back(usblFrame(kOrigin, out.usbl_node, out.T_nav_usbl, valueAt(sigmas, 0.5), noise));
}

// Sensors and visual odometry, weighed as NavigationGraph judges them.
NavigationSolution judged(NavigationConfig config, const std::vector<KeyframeInput>& frames,
                          const Eigen::Vector2d& shift, double sigma, std::vector<NavigationLink>& links) {
  NavigationSolution out;
  const int n = static_cast<int>(frames.size());
  std::vector<const NavigationLink*> visual(frames.size(), nullptr);
  for (const NavigationLink& link : links)
    if (link.ofChain()) visual[link.b] = &link;
  config.max_keyframes = n + kSpareRoom;
  config.max_links = n + kSpareRoom;
  config.max_fixes = kSpareRoom;
  NavigationGraph sensors(config);
  sensors.setAnchor(shift, sigma);
  for (int k = 0; k < n; ++k) {
    if (!sensors.addKeyframe(frames[at(k)])) throw std::logic_error("navigation: no room for a frame");
    out.nodes.push_back(sensors.node(k));
    if (const NavigationLink* link = visual[at(k)])
      (void)sensors.addLink(LinkKind::kOdometry, k - 1, k, link->T_a_b, link->covariance, link->confirmed);
    sensors.judge();
  }
  out.sensors = sensors.counters();
  out.graph = sensors.sensorGraph();
  for (NavigationLink& link : links)
    if (link.ofChain()) {
      link.kept = sensors.visualInlier(static_cast<int>(link.b));
      link.weight = sensors.visualWeight(static_cast<int>(link.b));
    }
  return out;
}

}  // namespace

SensorNoise noiseBySteps(const SensorNoise& noise, const std::vector<KeyframeInput>& frames,
                         const std::vector<NavigationLink>& links, const Eigen::Vector3d& dvl_in_camera) {
  constexpr double kOfPlaces = 2.146;  // the length of a vector of two normal variables at kMostChanges
  SensorNoise seen = noise;
  std::vector<double> tilts, headings, velocities;
  const auto forSteps = [&](const auto& take) {
    for (const NavigationLink& link : links) {
      const KeyframeInput &a = frames[link.a], &b = frames[link.b];
      if (link.ofChain() && !a.attitude_held && !b.attitude_held && !b.compass_jumped && b.untilted_s == 0)
        take(link, a, b);
    }
  };
  forSteps([&](const NavigationLink& link, const KeyframeInput& a, const KeyframeInput& b) {
    const Eigen::Quaterniond by_images = a.T_odom_cam.rotation() * link.T_a_b.rotation();
    const Eigen::Vector3d off =
        SE3(by_images * b.T_odom_cam.rotation().conjugate(), Eigen::Vector3d::Zero()).log().tail<3>();
    tilts.insert(tilts.end(), {std::abs(off.x()), std::abs(off.y())});
    headings.push_back(std::abs(off.z()));
  });
  if (headings.empty()) return seen;
  seen.heading = std::max(noise.heading, valueAt(headings, kMostChanges) / kOfChanges);
  seen.tilt = std::max(noise.tilt, valueAt(tilts, kMostChanges) / kOfChanges);
  forSteps([&](const NavigationLink& link, const KeyframeInput& a, const KeyframeInput& b) {
    if (b.unlocked_s > 0) return;
    const SE3 by_images = a.T_odom_cam * link.T_a_b;
    StepQuality quality;
    quality.seconds = rt::seconds(b.utc_ns - a.utc_ns);
    quality.turn = by_images.rotation().angularDistance(a.T_odom_cam.rotation());
    const double path = (link.T_a_b * dvl_in_camera - dvl_in_camera).norm(),
                 off =
                     (by_images * dvl_in_camera - b.T_odom_cam * dvl_in_camera).head<2>().norm() / kOfPlaces,
                 white2 = noise.dvl_velocity * noise.dvl_velocity * quality.seconds / noise.dvl_rate,
                 sigma = stepSigma(path, quality, seen);
    if (white2 > 0) velocities.push_back(1 + (off * off - sigma * sigma) / white2);
  });
  if (!velocities.empty()) seen.dvl_velocity *= std::sqrt(std::max(1.0, valueAt(velocities, kMostChanges)));
  return seen;
}

SensorNoise adaptedNoise(const SensorNoise& noise, const std::vector<KeyframeInput>& frames,
                         const std::vector<NavigationFix>& fixes, const NavigationSolution& solved) {
  SensorNoise seen = noise;
  // Of the compass and of tilt, in nav's axes.
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), squares = Eigen::Vector3d::Zero();
  std::optional<Eigen::Vector3d> last;
  std::vector<double> tilts, headings;  // changes of one reading's error to the next's
  double count = 0;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (frames[k].attitude_held) {
      last.reset();
      continue;
    }
    const Eigen::Vector3d off =
        SE3(solved.poses[k].rotation() * frames[k].T_odom_cam.rotation().conjugate(), Eigen::Vector3d::Zero())
            .log()
            .tail<3>();
    sum += off, squares += off.cwiseAbs2(), ++count;
    if (last) {
      const Eigen::Vector3d change = (off - *last).cwiseAbs();
      tilts.insert(tilts.end(), {change.x(), change.y()});
      headings.push_back(change.z());
    }
    last = off;
  }
  if (count > 0) {
    const Eigen::Vector3d spread = (squares / count - (sum / count).cwiseAbs2()).cwiseMax(0);
    seen.deviation = hypotenuse(noise.deviation, std::sqrt(spread.z()));
    seen.tilt_bias = hypotenuse(noise.tilt_bias, std::sqrt(0.5 * (spread.x() + spread.y())));
  }
  if (!headings.empty()) {
    seen.heading = std::max(noise.heading, valueAt(headings, kMostChanges) / kOfChanges);
    seen.tilt = std::max(noise.tilt, valueAt(tilts, kMostChanges) / kOfChanges);
  }
  std::vector<double> apart;
  for (const NavigationFix& fix : fixes) {
    if (!fix.by_usbl) continue;
    const SE3 T_nav_odom = solved.poses[at(fix.frame)] * frames[at(fix.frame)].T_odom_cam.inverse();
    apart.push_back(((T_nav_odom * fix.antenna_in_odom).head<2>() - fix.north_east).norm());
  }
  if (!apart.empty()) seen.usbl_shift = std::max(noise.usbl_shift, valueAt(apart, kAgreeing) / kOfAgreeing);
  return seen;
}

NavigationSolution solveNavigation(const NavigationConfig& config, const std::vector<KeyframeInput>& frames,
                                   const Eigen::Vector2d& shift, double sigma,
                                   std::vector<NavigationLink>& links, std::vector<NavigationFix>& fixes,
                                   NavigationSolution before) {
  NavigationSolution out = std::move(before);
  if (frames.empty()) return out;
  for (const NavigationLink& link : links)
    if (link.a >= frames.size() || link.b >= frames.size() || link.a == link.b)
      throw std::invalid_argument("navigation: a link names a frame that is not there");
  if (out.nodes.empty()) {
    out = judged(config, frames, shift, sigma, links);
    addUsbl(config.noise, fixes, out);
    out.certain = out.graph.edges.size();
  }
  RobustBatch robust(config, frames, out, links, fixes);
  for (int round = 0; round < kWeightRounds; ++round) {
    out.graph.edges.resize(out.certain);
    robust.append(out.graph.poses, out.graph.edges);
    // A round begins where the last one ended.
    out.converged = optimize(out.graph, {.chordal = round == 0}).converged;
    if (!robust.weigh(out.graph.poses)) break;
  }
  robust.judge(out.graph.poses);
  out.poses.clear();
  for (const int node : out.nodes) out.poses.push_back(out.graph.poses[at(node)]);
  return out;
}

}  // namespace fathom::slam

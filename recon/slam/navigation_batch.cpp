#include "recon/slam/navigation_batch.hpp"

#include <algorithm>
#include <stdexcept>

#include "recon/slam/batch_solver.hpp"

namespace fathom::slam {
namespace {

constexpr int kReweightings = 4;       // Cauchy's weights settle within three
constexpr int kRounds = 8;             // in which links are taken out and come back
constexpr double kRemovalShare = 0.5;  // of the worst link's chi2: those worse go first
constexpr int kOrigin = 0;             // nav's origin in the graph
constexpr int kSpare = 16;             // room beyond what is known to come

std::size_t at(int i) {
  return static_cast<std::size_t>(i);
}

double chiSquareOf(const RelativePose& edge, const std::vector<SE3>& poses) {
  const Vector6d error = relativePoseError(edge, poses[at(edge.from)], poses[at(edge.to)]);
  return error.dot(edge.information * error);
}

// Links and fixes: what may be wrong.
class Doubtful {
 public:
  Doubtful(const NavigationConfig& config, const std::vector<KeyframeInput>& frames,
           const std::vector<int>& nodes, std::vector<NavigationLink>& links,
           std::vector<NavigationFix>& fixes)
      : config_(config), frames_(frames), nodes_(nodes), links_(links), fixes_(fixes) {}

  // Weighted factors of all that is kept, by how far they are from `poses`.
  void append(const std::vector<SE3>& poses, bool weighted, std::vector<RelativePose>& edges) const {
    for (const NavigationLink& link : links_)
      if (link.kept) edges.push_back(weighed(edgeOf(link), poses, kLinkFree, weighted));
    for (const NavigationFix& fix : fixes_)
      if (fix.kept) edges.push_back(weighed(edgeOf(fix, poses), poses, kFixFree, weighted));
  }

  // What was taken out comes back when it fits now: beside a bad link good ones look bad. True when anything
  // changed.
  bool judge(const std::vector<SE3>& poses, bool final) {
    for (NavigationLink& link : links_) link.chi2 = chiSquareOf(edgeOf(link), poses);
    for (NavigationFix& fix : fixes_) fix.chi2 = chiSquareOf(edgeOf(fix, poses), poses);
    if (final) return false;
    const bool changed = sift(links_, config_.gate);
    return sift(fixes_, config_.fix_gate) || changed;
  }

 private:
  template <typename Item>
  static bool sift(std::vector<Item>& items, double gate) {
    double worst = 0;
    for (const Item& item : items)
      if (item.kept) worst = std::max(worst, item.chi2);
    const double limit = std::max(gate, kRemovalShare * worst);
    bool changed = false;
    for (Item& item : items) {
      const bool fits = item.chi2 <= (item.kept ? limit : gate);
      changed = changed || fits != item.kept;
      item.kept = fits;
    }
    return changed;
  }
  static RelativePose weighed(RelativePose edge, const std::vector<SE3>& poses, double free, bool weighted) {
    if (weighted) edge.information *= cauchyWeight(chiSquareOf(edge, poses), free);
    return edge;
  }
  RelativePose edgeOf(const NavigationLink& link) const {
    return linkFactor(nodes_[link.a], nodes_[link.b], link.T_a_b, link.covariance);
  }
  RelativePose edgeOf(const NavigationFix& fix, const std::vector<SE3>& poses) const {
    const int node = nodes_[at(fix.frame)];
    return fixFactor(kOrigin, node, poses[at(node)], frames_[at(fix.frame)].T_odom_cam, fix.antenna_in_odom,
                     fix.north_east, fix.sigma);
  }

  const NavigationConfig& config_;
  const std::vector<KeyframeInput>& frames_;
  const std::vector<int>& nodes_;
  std::vector<NavigationLink>& links_;
  std::vector<NavigationFix>& fixes_;
};

}  // namespace

NavigationSolution solveNavigation(NavigationConfig config, const std::vector<KeyframeInput>& frames,
                                   const Eigen::Vector2d& shift, double sigma,
                                   std::vector<NavigationLink>& links, std::vector<NavigationFix>& fixes) {
  NavigationSolution out;
  if (frames.empty()) return out;
  const int n = static_cast<int>(frames.size());
  std::vector<const NavigationLink*> visual(frames.size(), nullptr);
  for (const NavigationLink& link : links) {
    if (link.a >= frames.size() || link.b >= frames.size() || link.a == link.b)
      throw std::invalid_argument("navigation: a link names a frame that is not there");
    if (link.b == link.a + 1) visual[link.b] = &link;
  }
  config.max_keyframes = n + kSpare;
  config.max_links = n + kSpare;
  config.max_fixes = kSpare;
  NavigationGraph sensors(config);
  sensors.setAnchor(shift, sigma);
  for (int k = 0; k < n; ++k) {
    if (!sensors.addKeyframe(frames[at(k)])) throw std::logic_error("navigation: no room for a frame");
    out.nodes.push_back(sensors.node(k));
    if (const NavigationLink* link = visual[at(k)])
      (void)sensors.addLink(LinkKind::kOdometry, k - 1, k, link->T_a_b, link->covariance);
  }
  out.sensors = sensors.counters();
  out.dvl_scale = sensors.dvl().scale();
  out.dvl_heading = sensors.dvl().heading();
  out.graph = sensors.sensorGraph();
  const std::size_t certain = out.graph.edges.size();

  Doubtful doubtful(config, frames, out.nodes, links, fixes);
  for (int round = 0; round <= kRounds; ++round) {
    for (int k = 0; k < kReweightings; ++k) {
      out.graph.edges.resize(certain);
      doubtful.append(out.graph.poses, round > 0 || k > 0, out.graph.edges);
      out.converged = optimize(out.graph, {}).converged;
    }
    if (!doubtful.judge(out.graph.poses, round == kRounds)) break;
  }
  for (const int node : out.nodes) out.poses.push_back(out.graph.poses[at(node)]);
  return out;
}

}  // namespace fathom::slam

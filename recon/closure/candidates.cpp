#include "recon/closure/candidates.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::closure {
namespace {

constexpr double kPi = 3.14159265358979323846;

// Nodes and weights of Gauss-Legendre on [-1, 1], the positive half of 16.
constexpr double kNodes[8] = {0.0950125098376374, 0.2816035507792589, 0.4580167776572274, 0.6178762444026438,
                              0.7554044083550030, 0.8656312023878318, 0.9445750230732326, 0.9894009349916499};
constexpr double kWeights[8] = {0.1894506104550685, 0.1826034150449236, 0.1691565193950025,
                                0.1495959888165767, 0.1246289712555339, 0.0951585116824928,
                                0.0622535239386479, 0.0271524594117541};

bool less(const Candidate& a, const Candidate& b) {
  return std::make_tuple(a.value(), a.newer, a.older) < std::make_tuple(b.value(), b.newer, b.older);
}

constexpr std::uint32_t kMostFrames = 8;      // of a stretch
constexpr double kStretchLength_m = 3;        // of its track, at most
constexpr double kMaxSigmaOfStretch_m = 0.1;  // between two middles; above, single frames

// Largest standard deviation of a separation, along any direction [m].
double widestSigma(const Eigen::Matrix2d& covariance) {
  const double mean = 0.5 * covariance.trace();
  const double apart = hypotenuse(0.5 * (covariance(0, 0) - covariance(1, 1)), covariance(0, 1));
  return std::sqrt(std::max(mean + apart, 0.0));
}

}  // namespace

Footprint footprintOf(const SE3& T_nav_cam, double range, const Camera& camera) {
  const Eigen::Vector3d hit = T_nav_cam * Eigen::Vector3d(0, 0, range);
  return {hit.head<2>(), range * std::sqrt(static_cast<double>(camera.width) * camera.height /
                                           (kPi * camera.fx * camera.fy))};
}

double rangeToLevelGround(const SE3& T_nav_cam, double altitude) {
  constexpr double kMinDown = 0.2;  // cosine from the vertical; flatter, the seafloor is out of range
  return altitude / std::max((T_nav_cam.rotation() * Eigen::Vector3d::UnitZ()).z(), kMinDown);
}

double separationOfOverlap(double share) {
  double low = 0, high = 2;
  constexpr int kHalvings = 50;
  for (int i = 0; i < kHalvings; ++i) {
    const double d = 0.5 * (low + high);
    const double lens = 2 * std::acos(d / 2) - d / 2 * std::sqrt(4 - d * d);
    (lens > share * kPi ? low : high) = d;
  }
  return low;
}

double overlapProbability(const Eigen::Vector2d& mean, const Eigen::Matrix2d& covariance, double reach) {
  constexpr double kTail = 6;      // standard deviations
  constexpr double kLeast = 1e-6;  // standard deviation of a certain separation [m]
  constexpr int kPanels = 2;
  if (!(reach > 0) || !mean.allFinite() || !covariance.allFinite()) return 0;
  const SymmetricEigen<2> axes = symmetricEigen(covariance);
  const Eigen::Vector2d m = axes.vectors.transpose() * mean;
  const double sy = std::sqrt(std::max(axes.values(0), kLeast * kLeast));  // narrow
  const double sx = std::sqrt(std::max(axes.values(1), kLeast * kLeast));
  if (m.norm() + kTail * sx < reach) return 1;
  if (m.norm() - kTail * sx > reach) return 0;
  const double from = std::max(-reach, m.y() - kTail * sx), to = std::min(reach, m.y() + kTail * sx);
  if (from >= to) return 0;
  const auto density = [&](double x) {
    const double half = std::sqrt(std::max(reach * reach - x * x, 0.0)), u = (x - m.y()) / sx;
    return std::exp(-0.5 * u * u) / (sx * std::sqrt(2 * kPi)) *
           (shareBelow((half - m.x()) / sy) - shareBelow((-half - m.x()) / sy));
  };
  double sum = 0;
  const double width = (to - from) / kPanels;
  for (int panel = 0; panel < kPanels; ++panel) {
    const double middle = from + (panel + 0.5) * width;
    for (int k = 0; k < 8; ++k)
      sum += kWeights[k] * 0.5 * width *
             (density(middle - kNodes[k] * 0.5 * width) + density(middle + kNodes[k] * 0.5 * width));
  }
  return std::clamp(sum, 0.0, 1.0);
}

double expectedInformation(const Eigen::Matrix2d& covariance, double sigma) {
  return 0.5 * std::log((Eigen::Matrix2d::Identity() + covariance / (sigma * sigma)).determinant());
}

Candidate candidateOf(std::uint32_t older, const Footprint& there, std::uint32_t newer, const Footprint& here,
                      const Eigen::Matrix2d& covariance, const CandidateConfig& config, double apart) {
  const double reach = apart * 0.5 * (here.radius + there.radius);
  return {older, newer, overlapProbability(here.centre - there.centre, covariance, reach),
          expectedInformation(covariance, config.sigma_measured)};
}

CandidateQueue::CandidateQueue(const CandidateConfig& config) : config_(config) {
  if (!(config.min_overlap > 0 && config.min_overlap < 1) || !(config.sigma_measured > 0) ||
      config.capacity == 0)
    throw std::invalid_argument(
        "closure candidates: 0 < min_overlap < 1, sigma_measured and capacity above 0");
  waiting_.reserve(config.capacity);
}

void CandidateQueue::push(const Candidate& candidate) {
  const auto place = std::lower_bound(waiting_.begin(), waiting_.end(), candidate, less);
  if (waiting_.size() < config_.capacity) {
    waiting_.insert(place, candidate);
    return;
  }
  ++dropped_;
  if (place == waiting_.begin()) return;
  std::move(waiting_.begin() + 1, place, waiting_.begin());
  *(place - 1) = candidate;
}

bool CandidateQueue::pop(Candidate& candidate) {
  if (waiting_.empty()) return false;
  candidate = waiting_.back();
  waiting_.pop_back();
  return true;
}

void CandidateQueue::save(rt::StateWriter& writer) const {
  writer.bounded(waiting_, config_.capacity);
  writer(dropped_);
}

bool CandidateQueue::load(rt::StateReader& reader, std::size_t frames) {
  reader.bounded(waiting_, config_.capacity);
  reader(dropped_);
  for (const Candidate& c : waiting_)
    reader.require(c.older < c.newer && c.newer < frames && std::isfinite(c.value()),
                   "a candidate that cannot be");
  reader.require(std::is_sorted(waiting_.begin(), waiting_.end(), less), "candidates out of order");
  return reader.ok();
}

std::vector<Stretch> stretchesOf(std::span<const Footprint> footprints, const Separation& separation) {
  const auto count = static_cast<std::uint32_t>(footprints.size());
  std::vector<Stretch> even;
  double track = 0;  // of the present stretch [m]
  for (std::uint32_t k = 0; k < count; ++k) {
    if (k > 0) track += (footprints[k].centre - footprints[k - 1].centre).norm();
    if (k == 0 || track > kStretchLength_m || k - even.back().first == kMostFrames) {
      even.push_back({k, k});
      track = 0;
    }
    even.back().end = k + 1;
  }
  std::vector<bool> cut(even.size(), false);
  for (std::size_t s = 1; s < even.size(); ++s)
    if (widestSigma(separation(even[s - 1].middle(), even[s].middle())) > kMaxSigmaOfStretch_m)
      cut[s - 1] = cut[s] = true;
  std::vector<Stretch> stretches;
  for (std::size_t s = 0; s < even.size(); ++s) {
    if (!cut[s]) {
      stretches.push_back(even[s]);
      continue;
    }
    for (std::uint32_t k = even[s].first; k < even[s].end; ++k) stretches.push_back({k, k + 1});
  }
  return stretches;
}

StretchTree::StretchTree(std::span<const Footprint> footprints, std::vector<Stretch> stretches,
                         double min_overlap, const Separation& separation)
    : footprints_(footprints),
      stretches_(std::move(stretches)),
      reach_(separationOfOverlap(min_overlap)),
      leaf_(stretches_.size()) {
  if (!stretches_.empty()) (void)build(0, static_cast<std::uint32_t>(stretches_.size()), separation);
}

int StretchTree::build(std::uint32_t first, std::uint32_t end, const Separation& separation) {
  const int index = static_cast<int>(nodes_.size());
  Node node;
  node.first = first;
  node.end = end;
  node.middle = stretches_[first + (end - first) / 2].middle();
  nodes_.push_back(node);
  if (end - first == 1) {
    leaf_[first] = index;
    node.low = node.high = footprints_[stretches_[first].first].centre;
    for (std::uint32_t k = stretches_[first].first; k < stretches_[first].end; ++k) {
      node.low = node.low.cwiseMin(footprints_[k].centre);
      node.high = node.high.cwiseMax(footprints_[k].centre);
      node.radius = std::max(node.radius, footprints_[k].radius);
    }
  } else {
    const std::uint32_t half = first + (end - first) / 2;
    node.left = build(first, half, separation);
    node.right = build(half, end, separation);
    const Node &left = nodes_[static_cast<std::size_t>(node.left)],
               &right = nodes_[static_cast<std::size_t>(node.right)];
    node.low = left.low.cwiseMin(right.low);
    node.high = left.high.cwiseMax(right.high);
    node.radius = std::max(left.radius, right.radius);
    for (const Node* part : {&left, &right}) {
      const auto [older, newer] = std::minmax(node.middle, part->middle);
      const double between = older == newer ? 0 : widestSigma(separation(older, newer));
      node.leg = std::max(node.leg, between + part->leg);
    }
  }
  nodes_[static_cast<std::size_t>(index)] = node;
  return index;
}

void StretchTree::near(std::uint32_t stretch, const Separation& separation, std::vector<Near>& found) const {
  found.clear();
  const Node& here = nodes_[static_cast<std::size_t>(leaf_[stretch])];
  std::vector<int> stack = {0};
  while (!stack.empty()) {
    const Node& node = nodes_[static_cast<std::size_t>(stack.back())];
    stack.pop_back();
    if (node.first >= stretch) continue;
    const Eigen::Vector2d gap =
        (node.low - here.high).cwiseMax(here.low - node.high).cwiseMax(Eigen::Vector2d::Zero());
    const double apart = gap.norm() - reach_ * 0.5 * (here.radius + node.radius);
    const bool single = node.left < 0;
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
    // A node that holds newer frames too is opened, because its middle may be one of them.
    const bool older = node.end <= stretch;
    if (older && (single || apart > 0)) {
      covariance = separation(node.middle, here.middle);
      if (apart > kSigmas * (widestSigma(covariance) + node.leg)) continue;
    }
    if (single) {
      found.push_back({node.first, covariance});
    } else {
      stack.push_back(node.right);
      stack.push_back(node.left);
    }
  }
}

}  // namespace fathom::closure

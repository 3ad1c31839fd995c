#include "recon/closure/stretches.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace fathom::closure {
namespace {

constexpr std::uint32_t kMostFrames = 8;      // of a stretch
constexpr double kStretchLength_m = 3;        // of its track, at most
constexpr double kMaxSigmaOfStretch_m = 0.1;  // between two middles; above, single frames

// Largest standard deviation of a separation, along any direction [m].
double widestSigma(const Eigen::Matrix2d& covariance) {
  const double mean = 0.5 * covariance.trace();
  const double apart = std::hypot(0.5 * (covariance(0, 0) - covariance(1, 1)), covariance(0, 1));
  return std::sqrt(std::max(mean + apart, 0.0));
}

}  // namespace

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

#include "recon/surface/view_index.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fathom::surface {
namespace {

constexpr std::uint32_t kLeafViews = 8;

bool meet(const std::array<double, 4>& a, const std::array<double, 4>& b) {
  return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

bool usable(const std::array<double, 4>& box) {
  return std::all_of(box.begin(), box.end(), [](double v) { return std::isfinite(v); }) && box[0] <= box[2] &&
         box[1] <= box[3];
}

}  // namespace

ViewIndex::ViewIndex(std::vector<View> views) : views_(std::move(views)) {
  for (std::uint32_t i = 0; i < views_.size(); ++i)
    if (usable(views_[i].footprint)) order_.push_back(i);
  if (!order_.empty()) build(0, static_cast<std::uint32_t>(order_.size()));
}

std::uint32_t ViewIndex::build(std::uint32_t first, std::uint32_t count) {
  const auto place = static_cast<std::uint32_t>(nodes_.size());
  constexpr double kFar = std::numeric_limits<double>::infinity();
  Node node{{kFar, kFar, -kFar, -kFar}, first, count, 0};
  for (std::uint32_t i = first; i < first + count; ++i) {
    const auto& box = views_[order_[i]].footprint;
    for (std::size_t side = 0; side < 2; ++side) {
      node.box[side] = std::min(node.box[side], box[side]);
      node.box[side + 2] = std::max(node.box[side + 2], box[side + 2]);
    }
  }
  nodes_.push_back(node);
  if (count <= kLeafViews) return place;

  const std::size_t axis = node.box[2] - node.box[0] >= node.box[3] - node.box[1] ? 0 : 1;
  const auto middle = [&](std::uint32_t i) {
    return views_[i].footprint[axis] + views_[i].footprint[axis + 2];
  };
  const std::uint32_t half = count / 2;
  const auto begin = order_.begin() + first;
  std::nth_element(begin, begin + half, begin + count, [&](std::uint32_t a, std::uint32_t b) {
    return middle(a) != middle(b) ? middle(a) < middle(b) : a < b;
  });
  nodes_[place].count = 0;
  build(first, half);
  const std::uint32_t right = build(first + half, count - half);
  nodes_[place].right = right;
  return place;
}

std::vector<std::uint32_t> ViewIndex::meeting(const std::array<double, 4>& box) const {
  std::vector<std::uint32_t> found, open;
  if (!nodes_.empty()) open.push_back(0);
  while (!open.empty()) {
    const std::uint32_t place = open.back();
    const Node& node = nodes_[place];
    open.pop_back();
    if (!meet(node.box, box)) continue;
    if (node.count == 0) {
      open.push_back(node.right);
      open.push_back(place + 1);
    }
    for (std::uint32_t i = node.first; i < node.first + node.count; ++i)
      if (meet(views_[order_[i]].footprint, box)) found.push_back(order_[i]);
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace fathom::surface

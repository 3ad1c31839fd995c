#include "recon/fusion/sight_map.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace fathom::fusion {
namespace {

// Points flatter to the side than this depth, in parts of their range, are outside the picture.
constexpr float kLeastForward = 0.2F;
constexpr float kFar = std::numeric_limits<float>::infinity();

void set(float (&axis)[3], const Eigen::Vector3f& v) {
  for (int k = 0; k < 3; ++k) axis[k] = v[k];
}
float dot(const float (&axis)[3], const Eigen::Vector3f& v) {
  return (axis[0] * v.x() + axis[1] * v.y()) + axis[2] * v.z();
}

int cellOf(float at) {
  return std::clamp(static_cast<int>(std::floor(at)), 0, SightPicture::kSize - 1);
}

// The least of each value and its two neighbours, `step` apart; beyond the ends nothing is known.
void leastOfThree(const float* from, std::size_t step, float beyond, float* to) {
  constexpr std::size_t kSize = SightPicture::kSize;
  for (std::size_t k = 0; k < kSize; ++k) {
    const float before = k > 0 ? from[(k - 1) * step] : beyond;
    const float after = k + 1 < kSize ? from[(k + 1) * step] : beyond;
    to[k * step] = std::min({before, from[k * step], after});
  }
}

void leastAround(float (&values)[SightPicture::kSize * SightPicture::kSize], float beyond) {
  constexpr std::size_t kSize = SightPicture::kSize;
  std::array<float, kSize * kSize> rows;
  for (std::size_t y = 0; y < kSize; ++y)
    leastOfThree(values + y * kSize, 1, beyond, rows.data() + y * kSize);
  for (std::size_t x = 0; x < kSize; ++x) leastOfThree(rows.data() + x, kSize, beyond, values + x);
}

}  // namespace

void SightMap::begin(const std::vector<Eigen::Vector3f>& points) {
  Eigen::Vector3f forward = Eigen::Vector3f::Zero();
  for (const Eigen::Vector3f& p : points) forward += p.normalized();
  if (!(forward.norm() > 0)) forward = Eigen::Vector3f::UnitZ();
  forward.normalize();
  const Eigen::Vector3f right = forward.unitOrthogonal();
  set(picture_.right, right);
  set(picture_.down, forward.cross(right));
  set(picture_.forward, forward);
  std::fill(std::begin(picture_.depth), std::end(picture_.depth), kFar);
  std::fill(std::begin(picture_.weight), std::end(picture_.weight), kFar);

  in_view_.assign(points.size(), {});
  Eigen::Array2f least = Eigen::Array2f::Constant(kFar), most = -least;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const float depth = dot(picture_.forward, points[k]);
    if (!(depth > kLeastForward * points[k].norm())) continue;
    in_view_[k] = {dot(picture_.right, points[k]) / depth, dot(picture_.down, points[k]) / depth, depth};
    const Eigen::Array2f at(in_view_[k].column, in_view_[k].row);
    least = least.min(at);
    most = most.max(at);
  }
  const float extent = (most - least).maxCoeff();
  picture_.scale = 0;
  if (!(extent > 0 && std::isfinite(extent))) return;
  picture_.origin[0] = least.x();
  picture_.origin[1] = least.y();
  picture_.scale = static_cast<float>(kSize) / extent;
  for (InView& at : in_view_) {
    at.column = (at.column - picture_.origin[0]) * picture_.scale;
    at.row = (at.row - picture_.origin[1]) * picture_.scale;
  }
}

void SightMap::add(const std::array<std::uint32_t, 3>& corners, float band, float weight) {
  const InView &a = in_view_[corners[0]], &b = in_view_[corners[1]], &c = in_view_[corners[2]];
  const float nearest = std::min({a.depth, b.depth, c.depth});
  if (!(nearest > 0)) return;
  const float depth = nearest - band;
  const int x0 = cellOf(std::min({a.column, b.column, c.column}));
  const int x1 = cellOf(std::max({a.column, b.column, c.column}));
  const int y0 = cellOf(std::min({a.row, b.row, c.row})), y1 = cellOf(std::max({a.row, b.row, c.row}));
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const int at = y * kSize + x;
      picture_.depth[at] = std::min(picture_.depth[at], depth);
      picture_.weight[at] = std::min(picture_.weight[at], weight);
    }
  }
}

void SightMap::close() {
  for (float& depth : picture_.depth) depth = depth < kFar && picture_.scale > 0 ? depth : -kFar;
  leastAround(picture_.depth, -kFar);
  leastAround(picture_.weight, 0);
}

bool SightMap::surelyUnknown(const Eigen::Vector3f& middle, float radius) const {
  const float depth = dot(picture_.forward, middle);
  const float nearest = depth - radius;
  if (picture_.scale <= 0) return true;
  if (!(nearest > kLeastForward * middle.norm())) return false;
  // x / z of the ball differs at most by this from its middle's.
  const Eigen::Array2f at(dot(picture_.right, middle) / depth, dot(picture_.down, middle) / depth);
  const float around = radius * (1 + at.abs().maxCoeff()) / nearest;
  const Eigen::Array2f cell = (at - Eigen::Array2f(picture_.origin[0], picture_.origin[1])) * picture_.scale;
  const float reach = around * picture_.scale + 1;
  const auto size = static_cast<float>(kSize);
  if ((cell + reach < 0).any() || (cell - reach > size).any()) return true;
  const int x0 = cellOf(cell.x() - reach), x1 = cellOf(cell.x() + reach);
  const int y0 = cellOf(cell.y() - reach), y1 = cellOf(cell.y() + reach);
  float most = -kFar;
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) most = std::max(most, picture_.depth[y * kSize + x]);
  return most <= nearest;
}

}  // namespace fathom::fusion

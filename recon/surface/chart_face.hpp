#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "recon/surface/atlas.hpp"

namespace fathom::surface {

// The texel centres (integer + 1/2) that a triangle covers, row by row: visit(row, first, last) for columns
// [first, last). Corners in texels with their `id`s: of two triangles at a side with the same ids and
// positions exactly one covers each centre there.
void forTriangleRows(const std::array<Eigen::Vector2d, 3>& corner, const std::array<std::uint32_t, 3>& id,
                     int first_row, int last_row, const auto& visit) {
  const double top = std::min({corner[0].y(), corner[1].y(), corner[2].y()});
  const double bottom = std::max({corner[0].y(), corner[1].y(), corner[2].y()});
  const auto centreAtOrAfter = [](double value) { return static_cast<int>(std::ceil(value - 0.5)); };
  const int begin = std::max(first_row, centreAtOrAfter(top));
  const int end = std::min(last_row, centreAtOrAfter(bottom));
  struct Side {
    double top, bottom, x, y, slope;
  };
  std::array<Side, 3> sides;
  for (std::size_t k = 0; k < 3; ++k) {
    std::size_t a = k, b = (k + 1) % 3;
    if (id[a] > id[b]) std::swap(a, b);  // the same numbers for both triangles of a side
    const Eigen::Vector2d edge = corner[b] - corner[a];
    sides[k] = {std::min(corner[a].y(), corner[b].y()), std::max(corner[a].y(), corner[b].y()), corner[a].x(),
                corner[a].y(), edge.y() != 0 ? edge.x() / edge.y() : 0};
  }
  for (int row = begin; row < end; ++row) {
    const double y = row + 0.5;
    double low = 0, high = 0;
    int crossings = 0;
    for (const Side& side : sides) {
      if (y < side.top || y >= side.bottom) continue;
      const double x = side.x + (y - side.y) * side.slope;
      low = crossings == 0 ? x : std::min(low, x);
      high = crossings == 0 ? x : std::max(high, x);
      ++crossings;
    }
    if (crossings == 2) visit(row, centreAtOrAfter(low), centreAtOrAfter(high));
  }
}

// A triangle projected into a chart: its corners in the atlas [texels, centres at half steps], and the points
// of its plane at texels [m, nav].
class ChartFace {
 public:
  // A face of the atlas in its own chart.
  ChartFace(const Atlas& atlas, std::uint32_t face)
      : ChartFace(atlas.charts[atlas.chart_of_face[face]], atlas.tile.surface.mesh, face) {}
  // A triangle of any mesh, projected along a chart's axis.
  ChartFace(const Chart& chart, const Mesh& mesh, std::uint32_t face) {
    const double texel2 = chart.right.squaredNorm();
    std::array<double, 3> height;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d p = mesh.vertices[mesh.triangles[face][k]].cast<double>() - chart.origin;
      corner_[k] = {chart.x + p.dot(chart.right) / texel2 + 0.5, chart.y + p.dot(chart.down) / texel2 + 0.5};
      height[k] = p.dot(chart.along);
    }
    // The plane's height along the axis as a function of column and row.
    const Eigen::Vector2d u = corner_[1] - corner_[0], v = corner_[2] - corner_[0];
    twice_area_ = u.x() * v.y() - u.y() * v.x();
    const double du = height[1] - height[0], dv = height[2] - height[0];
    if (std::abs(twice_area_) > kLeastArea)
      slope_ = {(du * v.y() - dv * u.y()) / twice_area_, (dv * u.x() - du * v.x()) / twice_area_};
    base_height_ = height[0];
    along_ = chart.along;
    right_ = chart.right;
    down_ = chart.down;
    corner_point_ = mesh.vertices[mesh.triangles[face][0]].cast<double>();
  }

  [[nodiscard]] const std::array<Eigen::Vector2d, 3>& corners() const { return corner_; }
  [[nodiscard]] double top() const { return std::min({corner_[0].y(), corner_[1].y(), corner_[2].y()}); }
  [[nodiscard]] double bottom() const { return std::max({corner_[0].y(), corner_[1].y(), corner_[2].y()}); }
  [[nodiscard]] double left() const { return std::min({corner_[0].x(), corner_[1].x(), corner_[2].x()}); }
  [[nodiscard]] double right() const { return std::max({corner_[0].x(), corner_[1].x(), corner_[2].x()}); }
  // Positive where the face looks towards the viewer.
  [[nodiscard]] double facing() const { return -twice_area_; }
  // Along the chart's axis from its origin [m].
  [[nodiscard]] double height(double column, double row) const {
    return base_height_ + slope_.x() * (column - corner_[0].x()) + slope_.y() * (row - corner_[0].y());
  }
  [[nodiscard]] Eigen::Vector3d point(double column, double row) const {
    const double c = column - corner_[0].x(), r = row - corner_[0].y();
    return corner_point_ + c * right_ + r * down_ + (slope_.x() * c + slope_.y() * r) * along_;
  }
  [[nodiscard]] Eigen::Vector3d columnStep() const { return right_ + slope_.x() * along_; }
  // The point that continues the face from `on`, a place of its rim, to `at`: slopes are limited to 45
  // degrees, so that it stays near the surface.
  [[nodiscard]] Eigen::Vector3d beyond(const Eigen::Vector2d& on, const Eigen::Vector2d& at) const {
    const Eigen::Vector2d step = at - on;
    const double most = step.norm() * right_.norm();
    const Eigen::Vector3d rim = point(on.x(), on.y());
    return rim + step.x() * right_ + step.y() * down_ + std::clamp(slope_.dot(step), -most, most) * along_;
  }

 private:
  static constexpr double kLeastArea = 1e-9;  // [texel^2]: seen edge on, the plane has no height

  std::array<Eigen::Vector2d, 3> corner_;
  Eigen::Vector2d slope_ = Eigen::Vector2d::Zero();  // height for a texel [m]
  double base_height_ = 0, twice_area_ = 0;
  Eigen::Vector3d along_, right_, down_, corner_point_;
};

}  // namespace fathom::surface

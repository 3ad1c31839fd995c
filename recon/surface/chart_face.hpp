#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cmath>

#include "recon/surface/atlas.hpp"

namespace fathom::surface {

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

#include "recon/fusion/sight_map.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace fathom::fusion {
namespace {

// Points flatter to the side than this depth, in parts of their range, are outside the picture.
constexpr double kLeastForward = 0.2;

}  // namespace

SightMap::SightMap(const Mesh& mesh, const Eigen::Vector3d& centre)
    : low_(INFINITY, INFINITY, 0), high_(-INFINITY, -INFINITY, 0), cells_(kSize * kSize) {
  Eigen::Vector3d forward = Eigen::Vector3d::Zero();
  for (const auto& t : mesh.triangles)
    for (const std::uint32_t v : t) forward += (mesh.vertices[v].cast<double>() - centre).normalized();
  if (!(forward.norm() > 0)) forward = Eigen::Vector3d::UnitZ();
  forward.normalize();
  const Eigen::Vector3d right = forward.unitOrthogonal();
  view_.row(0) = right;
  view_.row(1) = forward.cross(right);
  view_.row(2) = forward;

  Eigen::Vector2d least = Eigen::Vector2d::Constant(INFINITY), most = -least;
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t v : t) {
      const Eigen::Vector3d p = mesh.vertices[v].cast<double>() - centre;
      low_ = low_.cwiseMin(p);
      high_ = high_.cwiseMax(p);
      const Eigen::Vector3d q = view_ * p;
      if (!(q.z() > kLeastForward * q.norm())) continue;
      least = least.cwiseMin(q.head<2>() / q.z());
      most = most.cwiseMax(q.head<2>() / q.z());
    }
  }
  const double extent = (most - least).maxCoeff();
  if (!(extent > 0 && std::isfinite(extent))) return;
  origin_ = least;
  scale_ = (kSize - 1e-6) / extent;
}

void SightMap::add(const std::array<Eigen::Vector3d, 3>& corner, double band, double weight) {
  if (scale_ <= 0) return;
  Eigen::Vector2d least = Eigen::Vector2d::Constant(INFINITY), most = -least;
  double depth = INFINITY;
  for (const Eigen::Vector3d& p : corner) {
    const Eigen::Vector3d q = view_ * p;
    if (!(q.z() > kLeastForward * q.norm())) return;
    const Eigen::Vector2d cell = cellOf(q);
    least = least.cwiseMin(cell);
    most = most.cwiseMax(cell);
    depth = std::min(depth, q.z());
  }
  depth -= band;
  const auto cell = [](double x) { return std::clamp(static_cast<int>(std::floor(x)), 0, kSize - 1); };
  for (int y = cell(least.y()); y <= cell(most.y()); ++y) {
    for (int x = cell(least.x()); x <= cell(most.x()); ++x) {
      Cell& at = cells_[static_cast<std::size_t>(y * kSize + x)];
      at.depth = at.seen ? std::min(at.depth, depth) : depth;
      at.weight = at.seen ? std::min(at.weight, weight) : weight;
      at.seen = true;
    }
  }
}

void SightMap::close() {
  const std::vector<Cell> all = cells_;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      Cell& at = cells_[static_cast<std::size_t>(y * kSize + x)];
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const int nx = x + dx, ny = y + dy;
          const bool inside = nx >= 0 && nx < kSize && ny >= 0 && ny < kSize;
          const Cell near = inside ? all[static_cast<std::size_t>(ny * kSize + nx)] : Cell{};
          at.seen = at.seen && near.seen;
          at.depth = std::min(at.depth, near.depth);
          at.weight = std::min(at.weight, near.weight);
        }
      }
    }
  }
}

double SightMap::emptyWeight(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d q = view_ * point;
  if (scale_ <= 0 || !(q.z() > 0)) return 0;
  const Eigen::Vector2d cell = cellOf(q);
  if (!(cell.x() >= 0 && cell.x() < kSize && cell.y() >= 0 && cell.y() < kSize)) return 0;
  const Cell& at =
      cells_[static_cast<std::size_t>(static_cast<int>(cell.y()) * kSize + static_cast<int>(cell.x()))];
  return at.seen && q.z() < at.depth ? at.weight : 0;
}

}  // namespace fathom::fusion

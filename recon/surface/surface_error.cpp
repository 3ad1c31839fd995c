#include "recon/surface/surface_error.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace fathom::surface {
namespace {

// Squared distance of p to the triangle abc (Ericson, Real-Time Collision Detection, 5.1.5).
double squaredToTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                         const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return ap.squaredNorm();
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return bp.squaredNorm();
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return (ap - ab * (d1 / (d1 - d3))).squaredNorm();
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return cp.squaredNorm();
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return (ap - ac * (d2 / (d2 - d6))).squaredNorm();
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0)
    return (bp - (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))).squaredNorm();
  const double sum = va + vb + vc;
  if (!(sum > 0)) return ap.squaredNorm();  // no area, and none of its sides was nearer
  return (ap - ab * (vb / sum) - ac * (vc / sum)).squaredNorm();
}

class Bound {
 public:
  Bound(const Mesh& from, const Mesh& to, double tolerance)
      : from_(from), nearest_(to), tolerance_(tolerance) {}

  double run() {
    std::vector<NearestTriangle::Hit> at(from_.vertices.size());
    std::vector<std::uint8_t> used(from_.vertices.size(), 0);
    for (const auto& t : from_.triangles)
      for (const std::uint32_t v : t) used[v] = 1;
    std::uint32_t last = 0;
    for (std::size_t v = 0; v < at.size(); ++v) {
      if (used[v] == 0) continue;
      at[v] = nearest_(from_.vertices[v].cast<double>(), last);
      last = at[v].triangle;
      reached_ = std::max(reached_, at[v].squared);
    }
    reached_ = std::sqrt(reached_);
    bound_ = reached_;
    for (const auto& t : from_.triangles) {
      Corners corners;
      for (std::size_t k = 0; k < 3; ++k) corners[k] = {from_.vertices[t[k]].cast<double>(), at[t[k]]};
      divide(corners, 0);
    }
    return bound_;
  }

 private:
  struct Corner {
    Eigen::Vector3d point;
    NearestTriangle::Hit nearest;
  };
  using Corners = std::array<Corner, 3>;

  [[nodiscard]] double allowed() const {
    return std::max(bound_, reached_ + std::max(tolerance_, 0.05 * reached_));
  }

  void divide(const Corners& corners, int depth) {
    double upper = std::numeric_limits<double>::max();
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t face = corners[k].nearest.triangle;
      double worst = 0;
      for (const Corner& corner : corners)
        worst =
            std::max(worst, corner.nearest.triangle == face ? corner.nearest.squared
                                                            : nearest_.squaredDistance(corner.point, face));
      upper = std::min(upper, std::sqrt(worst));
    }
    // No point is farther than its corner's distance and the way there.
    double radius = 0, farthest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      radius = std::max(radius, (corners[k].point - corners[(k + 1) % 3].point).norm());
      farthest = std::max(farthest, std::sqrt(corners[k].nearest.squared));
    }
    upper = std::min(upper, farthest + radius / std::sqrt(3.0));
    if (upper <= allowed() || depth == kDeepest) {
      bound_ = std::max(bound_, upper);
      return;
    }
    std::array<Corner, 3> middle;  // of the side between k and k + 1
    for (std::size_t k = 0; k < 3; ++k) {
      const Corner& a = corners[k];
      const Corner& b = corners[(k + 1) % 3];
      middle[k].point = (a.point + b.point) / 2;
      middle[k].nearest = nearest_(middle[k].point, a.nearest.triangle);
      reached_ = std::max(reached_, std::sqrt(middle[k].nearest.squared));
    }
    for (std::size_t k = 0; k < 3; ++k) divide({corners[k], middle[k], middle[(k + 2) % 3]}, depth + 1);
    divide(middle, depth + 1);
  }

  // 4^12 parts of a triangle are never made: parts whose corners agree are not divided further.
  static constexpr int kDeepest = 12;

  const Mesh& from_;
  NearestTriangle nearest_;
  double tolerance_;
  double reached_ = 0, bound_ = 0;
};

}  // namespace

NearestTriangle::NearestTriangle(const Mesh& mesh) : mesh_(mesh) {
  Eigen::Vector3f low = mesh.vertices[mesh.triangles[0][0]], high = low;
  double edges = 0;
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3f& p = mesh.vertices[t[k]];
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
      edges += static_cast<double>((p - mesh.vertices[t[(k + 1) % 3]]).norm());
    }
  low_ = low.cast<double>();
  const Eigen::Vector3d extent = (high - low).cast<double>();
  const auto count = static_cast<double>(mesh.triangles.size());
  cell_ = std::max(edges / (3 * count), 1e-6);
  constexpr double kCellsPerTriangle = 4;  // so that a wide and sparse mesh takes no more memory than this
  const auto cells = [&] { return ((extent / cell_).array().floor() + 1).prod(); };
  while (cells() > kCellsPerTriangle * count + 64) cell_ *= 1.25;
  size_ = (extent / cell_).array().floor().cast<int>() + 1;

  const auto forCells = [&](std::size_t t, const auto& visit) {
    Eigen::Vector3f from = mesh.vertices[mesh.triangles[t][0]], to = from;
    for (std::size_t k = 1; k < 3; ++k) {
      from = from.cwiseMin(mesh.vertices[mesh.triangles[t][k]]);
      to = to.cwiseMax(mesh.vertices[mesh.triangles[t][k]]);
    }
    const Eigen::Array3i a = cellOf(from.cast<double>()), b = cellOf(to.cast<double>());
    for (int x = a.x(); x <= b.x(); ++x)
      for (int y = a.y(); y <= b.y(); ++y)
        for (int z = a.z(); z <= b.z(); ++z)
          visit((static_cast<std::size_t>(x) * static_cast<std::size_t>(size_.y()) +
                 static_cast<std::size_t>(y)) *
                    static_cast<std::size_t>(size_.z()) +
                static_cast<std::size_t>(z));
  };
  first_.assign(static_cast<std::size_t>(size_.cast<double>().prod()) + 1, 0);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    forCells(t, [&](std::size_t cell) { ++first_[cell + 1]; });
  for (std::size_t c = 1; c < first_.size(); ++c) first_[c] += first_[c - 1];
  triangles_.resize(first_.back());
  std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    forCells(t, [&](std::size_t cell) { triangles_[next[cell]++] = static_cast<std::uint32_t>(t); });
}

Eigen::Array3i NearestTriangle::cellOf(const Eigen::Vector3d& point) const {
  const Eigen::Array3d at = ((point - low_) / cell_).array().floor();
  return at.max(0).min((size_ - 1).cast<double>()).cast<int>();
}

double NearestTriangle::squaredDistance(const Eigen::Vector3d& point, std::uint32_t triangle) const {
  const auto& [a, b, c] = mesh_.triangles[triangle];
  return squaredToTriangle(point, mesh_.vertices[a].cast<double>(), mesh_.vertices[b].cast<double>(),
                           mesh_.vertices[c].cast<double>());
}

NearestTriangle::Hit NearestTriangle::operator()(const Eigen::Vector3d& point, std::uint32_t start) const {
  Hit best{start, squaredDistance(point, start)};
  const Eigen::Array3i at = cellOf(point);
  // A point outside the grid is nearer to its cells than to the cell it is counted in.
  const Eigen::Array3d inside =
      (point.array()).max(low_.array()).min(low_.array() + size_.cast<double>() * cell_);
  const int rings = size_.maxCoeff();
  for (int ring = 0; ring <= rings; ++ring) {
    // Cells of this ring are at least this far away.
    const Eigen::Array3d from_low = inside - (low_.array() + (at - (ring - 1)).cast<double>() * cell_);
    const Eigen::Array3d to_high = (low_.array() + (at + ring).cast<double>() * cell_) - inside;
    const double gap = std::max(0.0, std::min(from_low.minCoeff(), to_high.minCoeff()));
    if (ring > 0 && gap * gap >= best.squared) break;
    for (int x = std::max(0, at.x() - ring); x <= std::min(size_.x() - 1, at.x() + ring); ++x)
      for (int y = std::max(0, at.y() - ring); y <= std::min(size_.y() - 1, at.y() + ring); ++y) {
        const bool edge = std::abs(x - at.x()) == ring || std::abs(y - at.y()) == ring;
        for (int z = at.z() - ring; z <= at.z() + ring; z += edge || ring == 0 ? 1 : 2 * ring) {
          if (z < 0 || z >= size_.z()) continue;
          const std::size_t cell = (static_cast<std::size_t>(x) * static_cast<std::size_t>(size_.y()) +
                                    static_cast<std::size_t>(y)) *
                                       static_cast<std::size_t>(size_.z()) +
                                   static_cast<std::size_t>(z);
          for (std::uint32_t k = first_[cell]; k < first_[cell + 1]; ++k) {
            const double squared = squaredDistance(point, triangles_[k]);
            if (squared < best.squared || (squared == best.squared && triangles_[k] < best.triangle))
              best = {triangles_[k], squared};
          }
        }
      }
  }
  return best;
}

double distanceBound(const Mesh& from, const Mesh& to, double tolerance) {
  if (from.triangles.empty()) return 0;
  if (to.triangles.empty()) return std::numeric_limits<double>::infinity();
  return Bound(from, to, tolerance).run();
}

}  // namespace fathom::surface

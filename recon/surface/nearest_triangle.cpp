#include "recon/surface/nearest_triangle.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::surface {

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

  first_.assign(static_cast<std::size_t>(size_.cast<double>().prod()) + 1, 0);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    forCells(t, [&](std::size_t cell) { ++first_[cell + 1]; });
  for (std::size_t c = 1; c < first_.size(); ++c) first_[c] += first_[c - 1];
  triangles_.resize(first_.back());
  std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    forCells(t, [&](std::size_t cell) { triangles_[next[cell]++] = static_cast<std::uint32_t>(t); });
}

// Cells that the triangle's box meets.
template <typename Visit>
void NearestTriangle::forCells(std::size_t triangle, const Visit& visit) const {
  const auto& [i, j, k] = mesh_.triangles[triangle];
  const Eigen::Vector3f &p = mesh_.vertices[i], &q = mesh_.vertices[j], &r = mesh_.vertices[k];
  const Eigen::Array3i a = cellOf(p.cwiseMin(q).cwiseMin(r).cast<double>());
  const Eigen::Array3i b = cellOf(p.cwiseMax(q).cwiseMax(r).cast<double>());
  for (int x = a.x(); x <= b.x(); ++x)
    for (int y = a.y(); y <= b.y(); ++y)
      for (int z = a.z(); z <= b.z(); ++z) visit(number(x, y, z));
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

void NearestTriangle::search(std::size_t cell, const Eigen::Vector3d& point, Hit& best) const {
  for (std::uint32_t k = first_[cell]; k < first_[cell + 1]; ++k) {
    const double squared = squaredDistance(point, triangles_[k]);
    if (squared < best.squared || (squared == best.squared && triangles_[k] < best.triangle))
      best = {triangles_[k], squared};
  }
}

NearestTriangle::Hit NearestTriangle::operator()(const Eigen::Vector3d& point, std::uint32_t start) const {
  Hit best{start, squaredDistance(point, start)};
  // Rings of cells around the point until one has triangles, so that the box below is small.
  const Eigen::Array3i at = cellOf(point);
  const int rings = size_.maxCoeff();
  int ring = 0;
  for (bool found = false; ring <= rings && !found; ++ring)
    for (int x = std::max(0, at.x() - ring); x <= std::min(size_.x() - 1, at.x() + ring); ++x)
      for (int y = std::max(0, at.y() - ring); y <= std::min(size_.y() - 1, at.y() + ring); ++y) {
        const bool whole = ring == 0 || std::abs(x - at.x()) == ring || std::abs(y - at.y()) == ring;
        for (int z = at.z() - ring; z <= at.z() + ring; z += whole ? 1 : 2 * ring) {
          if (z < 0 || z >= size_.z()) continue;
          const std::size_t cell = number(x, y, z);
          found |= first_[cell] < first_[cell + 1];
          search(cell, point, best);
        }
      }
  // All other cells within the distance found.
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(std::sqrt(best.squared));
  const Eigen::Array3i a = cellOf(point - reach), b = cellOf(point + reach);
  for (int x = a.x(); x <= b.x(); ++x)
    for (int y = a.y(); y <= b.y(); ++y)
      for (int z = a.z(); z <= b.z(); ++z)
        if (std::max({std::abs(x - at.x()), std::abs(y - at.y()), std::abs(z - at.z())}) >= ring)
          search(number(x, y, z), point, best);
  return best;
}

}  // namespace fathom::surface

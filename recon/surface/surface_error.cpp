#include "recon/surface/surface_error.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace fathom::surface {
namespace {

constexpr std::uint32_t kNoFace = 0xFFFFFFFF;

// A convex part of a triangle.
struct Part {
  static constexpr std::size_t kMost = 12;  // corners: a cut adds at most one; parts with more are not cut
  std::array<Eigen::Vector3d, kMost> corner;
  std::size_t corners = 0;
  void add(const Eigen::Vector3d& p) { corner[corners++] = p; }
};

// A mesh's faces with their neighbours and the planes that stand on their sides, halfway between both faces.
class FaceWalls {
 public:
  struct Face {
    std::array<Eigen::Vector3d, 3> corner;
    std::array<Eigen::Vector3d, 3> outwards;  // of the wall on the side from corner k; zero at a border
    std::array<std::uint32_t, 3> neighbour;   // kNoFace at a border
  };

  explicit FaceWalls(const Mesh& mesh) : faces_(mesh.triangles.size()) {
    const auto& triangles = mesh.triangles;
    std::vector<std::uint32_t> first(mesh.vertices.size() + 1, 0), around(3 * triangles.size());
    for (const auto& t : triangles)
      for (const std::uint32_t v : t) ++first[v + 1];
    for (std::size_t v = 1; v < first.size(); ++v) first[v] += first[v - 1];
    std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
    for (std::uint32_t f = 0; f < triangles.size(); ++f)
      for (const std::uint32_t v : triangles[f]) around[next[v]++] = f;

    std::vector<Eigen::Vector3d> normal(triangles.size());
    for (std::size_t f = 0; f < triangles.size(); ++f) {
      auto& corner = faces_[f].corner;
      for (std::size_t k = 0; k < 3; ++k) corner[k] = mesh.vertices[triangles[f][k]].cast<double>();
      normal[f] = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
    }
    // Across a side is the first other face with the same two ends; of several any will do.
    for (std::uint32_t f = 0; f < triangles.size(); ++f)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = triangles[f][k], b = triangles[f][(k + 1) % 3];
        std::uint32_t other = kNoFace;
        for (std::uint32_t i = first[a]; i < first[a + 1] && other == kNoFace; ++i) {
          const auto& t = triangles[around[i]];
          if (around[i] != f && (t[0] == b || t[1] == b || t[2] == b)) other = around[i];
        }
        Face& face = faces_[f];
        face.neighbour[k] = other;
        face.outwards[k].setZero();
        if (other != kNoFace)
          face.outwards[k] =
              (face.corner[(k + 1) % 3] - face.corner[k]).cross(normal[f] + normal[other]).normalized();
      }
  }
  [[nodiscard]] const Face& operator[](std::uint32_t face) const { return faces_[face]; }

 private:
  std::vector<Face> faces_;
};

class Bound {
 public:
  Bound(const Mesh& from, const Mesh& to, double tolerance)
      : from_(from), nearest_(to), walls_(to), tolerance_(tolerance) {}

  double run() {
    for (const auto& t : from_.triangles) {
      std::array<Eigen::Vector3d, 3> corner;
      for (std::size_t k = 0; k < 3; ++k) corner[k] = from_.vertices[t[k]].cast<double>();
      decide(corner, 0);
    }
    return bound_;
  }

 private:
  using Corners = std::array<Eigen::Vector3d, 3>;
  static constexpr int kMostDivisions = 10;  // of one triangle: to a thousandth of its size
  static constexpr int kMostSteps = 64;      // from face to face
  static constexpr int kMostParts = 4096;    // of one triangle

  // Raises the bound to hold for the triangle.
  void decide(const Corners& corner, int divisions) {
    const Eigen::Vector3d middle = (corner[0] + corner[1] + corner[2]) / 3;
    const NearestTriangle::Hit hit = nearest_(middle, last_face_);
    last_face_ = hit.triangle;
    Part part;
    for (const Eigen::Vector3d& p : corner) part.add(p);
    worst_ = 0;
    parts_ = 0;
    walk(part, hit.triangle, kNoFace, 0);
    // No point is farther than the middle's distance plus its distance from the middle.
    double radius = 0;
    for (const Eigen::Vector3d& p : corner) radius = std::max(radius, (p - middle).norm());
    const double upper = std::min(std::sqrt(worst_), std::sqrt(hit.squared) + radius);
    if (upper <= bound_) return;
    const double lower = std::sqrt(std::max(hit.squared, nearest_(worst_place_, last_face_).squared));
    if (upper <= std::max(1.05 * lower, lower + tolerance_) || divisions == kMostDivisions) {
      bound_ = upper;
      return;
    }
    const Corners half = {(corner[0] + corner[1]) / 2, (corner[1] + corner[2]) / 2,
                          (corner[2] + corner[0]) / 2};
    decide({corner[0], half[0], half[2]}, divisions + 1);
    decide({half[0], corner[1], half[1]}, divisions + 1);
    decide({half[2], half[1], corner[2]}, divisions + 1);
    decide(half, divisions + 1);
  }

  // The part beyond a wall of the face is passed to the neighbour there; the rest is compared with the face.
  // The distance to any face is a bound, so every division gives one.
  void walk(Part& part, std::uint32_t number, std::uint32_t came_from, int steps) {
    const FaceWalls::Face& face = walls_[number];
    if (steps < kMostSteps && ++parts_ < kMostParts)
      for (std::size_t k = 0; k < 3 && part.corners > 0; ++k) {
        if (face.neighbour[k] == kNoFace || face.neighbour[k] == came_from) continue;
        Part beyond;
        cut(part, face.corner[k], face.outwards[k], beyond);
        if (beyond.corners > 0) walk(beyond, face.neighbour[k], number, steps + 1);
      }
    for (std::size_t i = 0; i < part.corners; ++i) {
      const double squared =
          squaredToTriangle(part.corner[i], face.corner[0], face.corner[1], face.corner[2]);
      if (squared <= worst_) continue;
      worst_ = squared;
      worst_place_ = part.corner[i];
    }
  }

  static void cut(Part& part, const Eigen::Vector3d& on, const Eigen::Vector3d& outwards, Part& beyond) {
    std::array<double, Part::kMost> height;
    bool any = false;
    for (std::size_t i = 0; i < part.corners; ++i) {
      height[i] = (part.corner[i] - on).dot(outwards);
      any |= height[i] > kOnWall;
    }
    if (!any || part.corners + 2 > Part::kMost) return;
    // A convex part crosses a plane twice; a sliver along it, by rounding, at nearly every corner.
    int crossings = 0;
    for (std::size_t i = 0; i < part.corners; ++i)
      crossings += (height[i] > 0) == (height[(i + 1) % part.corners] > 0) ? 0 : 1;
    if (crossings > 2) return;
    Part within;
    for (std::size_t i = 0; i < part.corners; ++i) {
      const std::size_t j = (i + 1) % part.corners;
      (height[i] > 0 ? beyond : within).add(part.corner[i]);
      if ((height[i] > 0) == (height[j] > 0)) continue;
      const Eigen::Vector3d crossing =
          part.corner[i] + (part.corner[j] - part.corner[i]) * (height[i] / (height[i] - height[j]));
      beyond.add(crossing);
      within.add(crossing);
    }
    part = within;
  }

  static constexpr double kOnWall = 1e-9;  // [m]: beyond by rounding only

  const Mesh& from_;
  NearestTriangle nearest_;
  FaceWalls walls_;
  double tolerance_;
  double bound_ = 0;
  std::uint32_t last_face_ = 0;
  double worst_ = 0;  // of the current triangle, squared
  Eigen::Vector3d worst_place_ = Eigen::Vector3d::Zero();
  int parts_ = 0;
};

}  // namespace

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
  if (!(sum > 0)) return ap.squaredNorm();  // without area, and no side was nearer
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
void NearestTriangle::forCells(std::size_t triangle, const auto& visit) const {
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

double distanceBound(const Mesh& from, const Mesh& to, double tolerance) {
  if (from.triangles.empty()) return 0;
  if (to.triangles.empty()) return std::numeric_limits<double>::infinity();
  return Bound(from, to, tolerance).run();
}

}  // namespace fathom::surface

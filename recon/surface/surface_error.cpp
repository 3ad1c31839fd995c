#include "recon/surface/surface_error.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "recon/surface/nearest_triangle.hpp"

namespace fathom::surface {
namespace {

constexpr std::uint32_t kNone = 0xFFFFFFFF;

// A convex part of a triangle.
struct Part {
  static constexpr std::size_t kMost =
      12;  // corners: a cut adds one at most; a part of more is cut no further
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
    std::array<std::uint32_t, 3> neighbour;   // kNone at a border
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
    // Across a side lies the first other face with the same two ends; more than one is as good.
    for (std::uint32_t f = 0; f < triangles.size(); ++f)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = triangles[f][k], b = triangles[f][(k + 1) % 3];
        std::uint32_t other = kNone;
        for (std::uint32_t i = first[a]; i < first[a + 1] && other == kNone; ++i) {
          const auto& t = triangles[around[i]];
          if (around[i] != f && (t[0] == b || t[1] == b || t[2] == b)) other = around[i];
        }
        Face& face = faces_[f];
        face.neighbour[k] = other;
        face.outwards[k].setZero();
        if (other != kNone)
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
    walk(part, hit.triangle, kNone, 0);
    // No point is farther than the middle's distance and the way there.
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

  // What of the part lies beyond a wall of the face goes on to the neighbour there; the rest is compared with
  // the face. Wherever a part ends up, its distance to that face is a bound.
  void walk(Part& part, std::uint32_t number, std::uint32_t came_from, int steps) {
    const FaceWalls::Face& face = walls_[number];
    if (steps < kMostSteps && ++parts_ < kMostParts)
      for (std::size_t k = 0; k < 3 && part.corners > 0; ++k) {
        if (face.neighbour[k] == kNone || face.neighbour[k] == came_from) continue;
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
  double worst_ = 0;  // of the triangle at hand, squared
  Eigen::Vector3d worst_place_ = Eigen::Vector3d::Zero();
  int parts_ = 0;
};

}  // namespace

double distanceBound(const Mesh& from, const Mesh& to, double tolerance) {
  if (from.triangles.empty()) return 0;
  if (to.triangles.empty()) return std::numeric_limits<double>::infinity();
  return Bound(from, to, tolerance).run();
}

}  // namespace fathom::surface

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fathom::stereo {

// Delaunay triangulation of points on the pixel lattice, by incremental insertion (Bowyer 1981, Watson 1981)
// with exact integer predicates: cocircular and collinear points, usual on a lattice, are handled, and equal
// points give equal triangles on every machine.
class Delaunay {
 public:
  using Point = std::array<std::int32_t, 2>;
  using Triangle = std::array<std::uint32_t, 3>;
  static constexpr std::int32_t kMaxCoordinate = 1 << 20;

  // Reserves the memory for this many points; more allocate.
  explicit Delaunay(std::size_t max_points = 0);

  // Triangles of indices into `points`, each turning from the first axis towards the second (clockwise if y
  // points down). Coordinates from 0 to kMaxCoordinate; of equal points only the first is used. Fewer than
  // three points, or all on a line, give none. The result is reused by the next call.
  const std::vector<Triangle>& triangulate(std::span<const Point> points);

 private:
  static constexpr std::int32_t kNone = -1;
  struct Face {
    std::array<std::int32_t, 3> vertex;
    std::array<std::int32_t, 3> neighbour;  // opposite to the vertex of the same number
  };
  struct Edge {
    std::int32_t from, to, outside;  // a side of the cavity, and the face beyond it
  };

  static std::size_t index(std::int32_t i) { return static_cast<std::size_t>(i); }
  void insert(std::int32_t vertex);
  [[nodiscard]] std::int32_t locate(const Point& p) const;
  [[nodiscard]] bool circleContains(const Face& face, const Point& p) const;
  void order(std::span<const Point> points);

  std::vector<Point> points_;  // the given ones and three far ones that enclose them
  std::vector<std::uint32_t> sequence_;
  std::vector<std::uint32_t> buckets_;  // where each bucket's points begin in the sequence
  bool small_ = false;                  // 64 bits hold the circle test of the given points
  std::vector<Face> faces_;
  std::vector<std::uint32_t> visited_;  // per face: the last insertion with it in the cavity
  std::uint32_t insertion_ = 0;
  std::int32_t last_ = 0;  // face where the next search begins
  std::vector<std::int32_t> cavity_;
  std::vector<Edge> boundary_;
  std::vector<std::int32_t> face_from_;  // per vertex: the new face with a boundary edge that begins there
  std::vector<Triangle> triangles_;
};

// Which points share an edge of a triangulation.
class TriangleLinks {
 public:
  // Reserves the memory for this many points.
  explicit TriangleLinks(std::size_t max_points);

  // Replaces the links by those of `triangles`, of indices below `points`.
  void build(std::size_t points, std::span<const Delaunay::Triangle> triangles);

  [[nodiscard]] std::span<const std::uint32_t> neighbours(std::size_t i) const {
    return {neighbours_.data() + first_[i], last_[i] - first_[i]};
  }
  [[nodiscard]] bool onOutline(std::size_t i) const { return outline_[i] != 0; }  // or without any triangle

 private:
  std::vector<std::uint32_t> first_, last_;  // of each point's neighbours, and one past them
  std::vector<std::uint32_t> neighbours_;
  std::vector<std::uint8_t> outline_;
};

}  // namespace fathom::stereo

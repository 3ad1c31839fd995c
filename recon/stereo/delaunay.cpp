#include "recon/stereo/delaunay.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace fathom::stereo {
namespace {

__extension__ using Wide = __int128;

constexpr std::size_t kTriangleLinks = 6;    // entries in the lists of neighbours for each triangle
constexpr int kFarPoints = 3;                // that enclose the given ones
constexpr std::int32_t kSmall = 1 << 14;     // below it 64 bits hold the circle test: 2 (14 + 14) + 1 + 2
constexpr std::size_t kBucketsPerPoint = 2;  // at most

// Twice the signed area of a, b, c: positive when they turn from the first axis towards the second.
std::int64_t orientation(const Delaunay::Point& a, const Delaunay::Point& b, const Delaunay::Point& c) {
  const std::int64_t abx = b[0] - a[0], aby = b[1] - a[1];
  const std::int64_t acx = c[0] - a[0], acy = c[1] - a[1];
  return abx * acy - aby * acx;
}

}  // namespace

Delaunay::Delaunay(std::size_t max_points) {
  const std::size_t n = max_points + 3, faces = 2 * n;
  points_.reserve(n);
  sequence_.reserve(n);
  buckets_.reserve(kBucketsPerPoint * n + 1);
  faces_.reserve(faces);
  visited_.reserve(faces);
  cavity_.reserve(faces);
  boundary_.reserve(faces + 2);
  face_from_.reserve(n);
  triangles_.reserve(faces);
}

bool Delaunay::circleContains(const Face& face, const Point& p) const {
  std::int64_t x[3], y[3], square[3];
  for (std::size_t i = 0; i < 3; ++i) {
    const Point& v = points_[index(face.vertex[i])];
    x[i] = v[0] - p[0];
    y[i] = v[1] - p[1];
    square[i] = x[i] * x[i] + y[i] * y[i];
  }
  if (small_ && std::max({face.vertex[0], face.vertex[1], face.vertex[2]}) <
                    static_cast<std::int32_t>(points_.size()) - kFarPoints)
    return square[0] * (x[1] * y[2] - x[2] * y[1]) + square[1] * (x[2] * y[0] - x[0] * y[2]) +
               square[2] * (x[0] * y[1] - x[1] * y[0]) >
           0;
  const Wide determinant = Wide(square[0]) * (x[1] * y[2] - x[2] * y[1]) +
                           Wide(square[1]) * (x[2] * y[0] - x[0] * y[2]) +
                           Wide(square[2]) * (x[0] * y[1] - x[1] * y[0]);
  return determinant > 0;
}

std::int32_t Delaunay::locate(const Point& p) const {
  std::int32_t face = last_;
  for (;;) {
    const Face& f = faces_[index(face)];
    std::int32_t next = kNone;
    for (std::size_t i = 0; i < 3 && next == kNone; ++i) {
      const Point& a = points_[index(f.vertex[(i + 1) % 3])];
      const Point& b = points_[index(f.vertex[(i + 2) % 3])];
      if (orientation(a, b, p) < 0) next = f.neighbour[i];
    }
    if (next == kNone) return face;
    face = next;
  }
}

void Delaunay::insert(std::int32_t vertex) {
  const Point p = points_[index(vertex)];
  const std::int32_t home = locate(p);
  for (const std::int32_t v : faces_[index(home)].vertex)
    if (points_[index(v)] == p) return;

  // The cavity: all faces with the point in their circumcircle; it is connected and star-shaped about
  // the point.
  ++insertion_;
  cavity_.assign(1, home);
  visited_[index(home)] = insertion_;
  boundary_.clear();
  for (std::size_t c = 0; c < cavity_.size(); ++c) {
    const Face face = faces_[index(cavity_[c])];
    for (std::size_t i = 0; i < 3; ++i) {
      const std::int32_t next = face.neighbour[i];
      if (next != kNone && visited_[index(next)] == insertion_) continue;
      if (next != kNone && circleContains(faces_[index(next)], p)) {
        visited_[index(next)] = insertion_;
        cavity_.push_back(next);
        continue;
      }
      boundary_.push_back({face.vertex[(i + 1) % 3], face.vertex[(i + 2) % 3], next});
    }
  }

  // A fan from the point to the boundary, which has two edges more than the cavity had faces.
  for (std::size_t e = 0; e < boundary_.size(); ++e) {
    const Edge& edge = boundary_[e];
    std::int32_t face = static_cast<std::int32_t>(faces_.size());
    if (e < cavity_.size()) {
      face = cavity_[e];
    } else {
      faces_.emplace_back();
      visited_.push_back(0);
    }
    faces_[index(face)] = {{edge.from, edge.to, vertex}, {kNone, kNone, edge.outside}};
    face_from_[index(edge.from)] = face;
    if (edge.outside == kNone) continue;
    Face& outside = faces_[index(edge.outside)];
    for (std::size_t i = 0; i < 3; ++i)
      if (outside.vertex[(i + 1) % 3] == edge.to && outside.vertex[(i + 2) % 3] == edge.from)
        outside.neighbour[i] = face;
  }
  for (const Edge& edge : boundary_) {
    const std::int32_t face = face_from_[index(edge.from)], next = face_from_[index(edge.to)];
    faces_[index(face)].neighbour[0] = next;  // shares the edge from `to` to the point
    faces_[index(next)].neighbour[1] = face;
    last_ = face;
  }
}

// Rows of square buckets, about one a point, in serpentine order: each point is near the one before, and the
// search for its face is short.
void Delaunay::order(std::span<const Point> points) {
  std::int32_t width = 1, height = 1;
  for (const Point& p : points) {
    width = std::max(width, p[0] + 1);
    height = std::max(height, p[1] + 1);
  }
  small_ = width <= kSmall && height <= kSmall;
  const double area = static_cast<double>(width) * height;
  const std::size_t most = kBucketsPerPoint * (points.size() + 3);
  auto edge = std::max(1, static_cast<std::int32_t>(std::sqrt(area / static_cast<double>(points.size()))));
  const auto across = [&](std::int32_t side) { return (side + edge - 1) / edge; };
  while (index(across(width)) * index(across(height)) > most) edge *= 2;
  const std::int32_t columns = across(width), rows = across(height);
  const auto bucket = [&](const Point& p) {
    const std::int32_t row = p[1] / edge, column = p[0] / edge;
    return index(row * columns + (row % 2 == 0 ? column : columns - 1 - column));
  };
  buckets_.assign(index(columns) * index(rows) + 1, 0);
  for (const Point& p : points) ++buckets_[bucket(p) + 1];
  std::partial_sum(buckets_.begin(), buckets_.end(), buckets_.begin());
  sequence_.resize(points.size());
  for (std::uint32_t i = 0; i < points.size(); ++i) sequence_[buckets_[bucket(points[i])]++] = i;
}

const std::vector<Delaunay::Triangle>& Delaunay::triangulate(std::span<const Point> points) {
  triangles_.clear();
  if (points.size() < 3) return triangles_;
  const auto n = static_cast<std::int32_t>(points.size());
  points_.assign(points.begin(), points.end());
  // So far away that the enclosing triangle's corners hide no edge of the hull but the flattest.
  constexpr std::int32_t kFar = 1 << 28;
  points_.push_back({-kFar, -kFar});
  points_.push_back({kFar, -kFar});
  points_.push_back({0, kFar});
  faces_.assign(1, {{n, n + 1, n + 2}, {kNone, kNone, kNone}});
  visited_.assign(1, 0);
  insertion_ = 0;
  last_ = 0;
  face_from_.assign(points_.size(), kNone);
  order(points);
  for (const std::uint32_t i : sequence_) insert(static_cast<std::int32_t>(i));

  for (const Face& f : faces_) {
    if (f.vertex[0] >= n || f.vertex[1] >= n || f.vertex[2] >= n) continue;
    triangles_.push_back({static_cast<std::uint32_t>(f.vertex[0]), static_cast<std::uint32_t>(f.vertex[1]),
                          static_cast<std::uint32_t>(f.vertex[2])});
  }
  return triangles_;
}

TriangleLinks::TriangleLinks(std::size_t max_points) {
  first_.reserve(max_points + 1);
  last_.reserve(max_points);
  neighbours_.reserve(2 * kTriangleLinks * max_points);
  outline_.reserve(max_points);
}

void TriangleLinks::build(std::size_t points, std::span<const Delaunay::Triangle> triangles) {
  first_.assign(points + 1, 0);
  for (const auto& t : triangles)
    for (const std::uint32_t v : t) first_[v + 1] += kTriangleLinks / 3;
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
  last_.assign(first_.begin(), first_.end() - 1);
  neighbours_.resize(triangles.size() * kTriangleLinks);
  outline_.resize(points);
  for (const auto& t : triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      neighbours_[last_[t[i]]++] = t[(i + 1) % 3];
      neighbours_[last_[t[i]]++] = t[(i + 2) % 3];
    }
  }
  // Each neighbour occurs twice, once for each triangle at the edge to it; on the outline once.
  for (std::size_t i = 0; i < points; ++i) {
    const auto begin = neighbours_.begin() + first_[i], end = neighbours_.begin() + last_[i];
    std::sort(begin, end);
    const auto unique_end = std::unique(begin, end);
    outline_[i] = 2 * (unique_end - begin) != end - begin || begin == end ? 1 : 0;
    last_[i] = static_cast<std::uint32_t>(unique_end - neighbours_.begin());
  }
}

}  // namespace fathom::stereo

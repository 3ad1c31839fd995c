#include "recon/surface/decimation.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>

namespace fathom::surface {
namespace {

using OpenMesh::EdgeHandle;
using OpenMesh::FaceHandle;
using OpenMesh::HalfedgeHandle;
using OpenMesh::VertexHandle;

// A point's weight beside the planes': enough to make flat places' best position unique and to prefer short
// edges there, too little to pull the surface (1 mm off the plane weighs as much as 0.3 m along it).
constexpr double kPointWeight = 1e-5;
// A hole's border is held by planes through it, as heavily as by another face.
constexpr double kBorderWeight = 1.0;
// A face may turn by this much in a collapse [cosine], about 70 degrees.
constexpr double kTurn = 0.35;
// Triangles of less quality (1: equilateral) than this are made only from worse ones; at shared edges, which
// do not grow with the inner ones, thinner ones must do.
constexpr double kQuality = 0.12, kQualityAtBorder = 0.004;

// Order of a collapse by its cost: in steps of a sixteenth of an octave. Within a step edges come as they are
// numbered, which is by place, so that what one collapse has touched is still in the cache for the next.
std::uint32_t rankOf(double cost) {
  constexpr int kMantissaBits = 23, kKept = 4;
  return std::bit_cast<std::uint32_t>(static_cast<float>(cost)) >> (kMantissaBits - kKept);
}

std::size_t index(const OpenMesh::BaseHandle& handle) {
  return static_cast<std::size_t>(handle.idx());
}

Eigen::Vector3d areaVector(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  return (b - a).cross(c - a) / 2;
}

// 4 sqrt(3) area / sum of squared sides.
double quality(double area, const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  return 4 * std::sqrt(3.0) * area / ((b - a).squaredNorm() + (c - b).squaredNorm() + (a - c).squaredNorm());
}

}  // namespace

Decimation::Decimation(const TileMesh& tile, SimplifyCounts& counts)
    : tile_(tile), counts_(counts), parts_(manifoldParts(tile.mesh.triangles, tile.mesh.vertices.size())) {
  const std::size_t count = parts_.original.size();
  const auto inNav = [&](std::size_t v) {
    return tile.mesh.vertices[parts_.original[v]].cast<double>().eval();
  };
  origin_ = count == 0 ? Eigen::Vector3d::Zero() : inNav(0);
  low_.setConstant(std::numeric_limits<double>::max());
  high_ = -low_;
  for (std::size_t v = 0; v < count; ++v) {
    const std::uint32_t old = parts_.original[v];
    position_.emplace_back(inNav(v) - origin_);
    sides_.push_back(tile.shared.empty() ? std::uint8_t{0} : tile.shared[old]);
    fixed_.push_back(sides_[v] != 0 || parts_.pinned[v] != 0);
    counts.pinned += parts_.pinned[v];
    if (sides_[v] == 0) {
      low_ = low_.min(position_[v].head<2>().array());
      high_ = high_.max(position_[v].head<2>().array());
    }
    if (!tile.mesh.sigma.empty()) sigma_.push_back(tile.mesh.sigma[old]);
    if (!tile.views.empty()) views_.push_back(tile.views[old]);
    if (!tile.mesh.colours.empty()) {
      const Rgb& rgb = tile.mesh.colours[old];
      colour_.emplace_back(rgb[0], rgb[1], rgb[2]);
    }
  }
  addFaces(count);
  addQuadrics();
}

void Decimation::addFaces(std::size_t vertices) {
  mesh_.request_vertex_status();
  mesh_.request_edge_status();
  mesh_.request_halfedge_status();
  mesh_.request_face_status();
  mesh_.reserve(vertices, 3 * parts_.triangles.size() / 2 + vertices / 4, parts_.triangles.size());
  for (std::size_t v = 0; v < vertices; ++v) mesh_.add_vertex();
  for (const auto& t : parts_.triangles) {
    std::array<VertexHandle, 3> v;
    bool fits = true;  // OpenMesh's own test, which prints to the terminal
    for (std::size_t k = 0; k < 3; ++k) v[k] = VertexHandle(static_cast<int>(t[k]));
    for (std::size_t k = 0; k < 3 && fits; ++k) {
      const HalfedgeHandle side = mesh_.find_halfedge(v[k], v[(k + 1) % 3]);
      fits = mesh_.is_boundary(v[k]) && (!side.is_valid() || mesh_.is_boundary(side));
    }
    if (fits && mesh_.add_face(v.data(), 3).is_valid()) continue;
    stranded_.push_back(t);
    for (const std::uint32_t vertex : t) fixed_[vertex] = 1;
  }
  counts_.stranded += stranded_.size();
  closeHoles(3, std::numeric_limits<double>::infinity());
  faces_ = mesh_.n_faces();
}

std::size_t Decimation::closeHoles(std::size_t most_edges, double largest) {
  std::size_t closed = 0;
  std::vector<HalfedgeHandle> outline;
  for (std::size_t h = 0; h < mesh_.n_halfedges(); ++h) {
    const HalfedgeHandle first(static_cast<int>(h));
    if (mesh_.status(mesh_.edge_handle(first)).deleted() || !mesh_.is_boundary(first)) continue;
    outline.clear();
    for (HalfedgeHandle side = first; outline.size() <= most_edges && (outline.empty() || side != first);
         side = mesh_.next_halfedge_handle(side))
      outline.push_back(side);
    if (outline.size() < 3 || outline.size() > most_edges) continue;
    bool done = closeHole(outline, largest);
    if (!done && outline.size() > 3) {  // by the other diagonal
      std::rotate(outline.begin(), outline.begin() + 1, outline.end());
      done = closeHole(outline, largest);
    }
    closed += done ? 1 : 0;
  }
  counts_.closed += closed;
  return closed;
}

bool Decimation::closeHole(const std::vector<HalfedgeHandle>& outline, double largest) {
  const std::size_t edges = outline.size();
  const auto corner = [&](std::size_t k) { return mesh_.from_vertex_handle(outline[k % edges]); };
  const auto onOneSide = [&](VertexHandle a, VertexHandle b) {
    return (sides_[index(a)] & sides_[index(b)]) != 0;
  };
  const auto normalBeside = [&](std::size_t k) {
    const HalfedgeHandle inner = mesh_.opposite_halfedge_handle(outline[k]);
    const VertexHandle apex = mesh_.to_vertex_handle(mesh_.next_halfedge_handle(inner));
    return areaVector(at(mesh_.from_vertex_handle(inner)), at(mesh_.to_vertex_handle(inner)), at(apex));
  };
  // Nothing new on a tile's side, where the neighbour would not have it.
  for (std::size_t k = 0; k < edges; ++k)
    if (onOneSide(corner(k), corner(k + 1))) return false;
  double area = 0;
  Eigen::Vector3d last = Eigen::Vector3d::Zero();
  for (std::size_t k = 1; k + 1 < edges; ++k) {
    const Eigen::Vector3d own = areaVector(at(corner(0)), at(corner(k)), at(corner(k + 1)));
    // The outline of a loose scrap is a loop too, where the new face would point in the opposite direction.
    if (own.dot(normalBeside(k)) <= 0 || (k == 1 && own.dot(normalBeside(0)) <= 0) ||
        (k + 2 == edges && own.dot(normalBeside(edges - 1)) <= 0))
      return false;
    if (k > 1 && (own.dot(last) <= 0 || onOneSide(corner(0), corner(k)) ||
                  mesh_.find_halfedge(corner(0), corner(k)).is_valid()))
      return false;
    last = own;
    area += own.norm();
  }
  if (area > largest) return false;
  std::vector<VertexHandle> corners;
  for (std::size_t k = 0; k < edges; ++k) corners.push_back(corner(k));
  for (std::size_t k = 1; k + 1 < edges; ++k) {
    if (!mesh_.add_face(corners[0], corners[k], corners[k + 1]).is_valid()) return false;
    ++faces_;
  }
  return true;
}

void Decimation::addQuadrics() {
  quadric_.resize(position_.size());
  facing_.assign(position_.size(), Eigen::Vector3d::Zero());
  for (const FaceHandle face : mesh_.faces()) {
    std::array<VertexHandle, 3> v;
    std::size_t k = 0;
    for (const VertexHandle vertex : mesh_.fv_range(face)) v[k++] = vertex;
    const Eigen::Vector3d twice = areaVector(at(v[0]), at(v[1]), at(v[2]));
    const double area = twice.norm();
    area_ += area;
    for (const VertexHandle vertex : v) {
      if (area > 0) quadric_[index(vertex)].addPlane(twice / area, at(vertex), area);
      quadric_[index(vertex)].addPoint(at(vertex), kPointWeight * area);
      facing_[index(vertex)] += twice;
    }
  }
  for (const auto& [a, b, c] : stranded_)
    area_ += areaVector(position_[a], position_[b], position_[c]).norm();
  for (const HalfedgeHandle side : mesh_.halfedges()) {
    if (!mesh_.is_boundary(side)) continue;
    const VertexHandle from = mesh_.from_vertex_handle(side), to = mesh_.to_vertex_handle(side);
    if (fixed(from) && fixed(to)) ++border_edges_;
    const HalfedgeHandle inner = mesh_.opposite_halfedge_handle(side);
    const VertexHandle apex = mesh_.to_vertex_handle(mesh_.next_halfedge_handle(inner));
    const Eigen::Vector3d along = at(to) - at(from);
    const Eigen::Vector3d outwards = along.cross(areaVector(at(from), at(to), at(apex)));
    const double length = outwards.norm();
    if (!(length > 0)) continue;
    for (const VertexHandle v : {from, to})
      quadric_[index(v)].addPlane(outwards / length, at(v), kBorderWeight * along.squaredNorm());
  }
}

void Decimation::pushAll() {
  turns_.clear();
  stamp_.assign(mesh_.n_edges(), 0);
  for (std::size_t e = 0; e < mesh_.n_edges(); ++e) {
    const EdgeHandle edge(static_cast<int>(e));
    Collapse collapse;
    if (!mesh_.status(edge).deleted() && plan(edge, collapse))
      turns_.push_back({rankOf(collapse.cost), static_cast<std::uint32_t>(e), 0});
  }
  std::make_heap(turns_.begin(), turns_.end());
}

void Decimation::push(EdgeHandle edge) {
  Collapse collapse;
  const std::uint32_t stamp = ++stamp_[index(edge)];
  if (!plan(edge, collapse)) return;
  turns_.push_back({rankOf(collapse.cost), static_cast<std::uint32_t>(edge.idx()), stamp});
  std::push_heap(turns_.begin(), turns_.end());
}

bool Decimation::plan(EdgeHandle edge, Collapse& collapse) const {
  HalfedgeHandle side = mesh_.halfedge_handle(edge, 0);
  VertexHandle from = mesh_.from_vertex_handle(side), to = mesh_.to_vertex_handle(side);
  if (fixed(from) && fixed(to)) return false;
  const bool from_at_hole = mesh_.is_boundary(from), to_at_hole = mesh_.is_boundary(to);
  // Two borders would meet across the surface.
  if (from_at_hole && to_at_hole && !mesh_.is_boundary(edge)) return false;
  if (fixed(from) || (from_at_hole && !to_at_hole)) {
    if (fixed(to) || (to_at_hole && !from_at_hole)) return false;
    side = mesh_.opposite_halfedge_handle(side);
    std::swap(from, to);
  }
  Quadric sum = quadric_[index(from)];
  sum += quadric_[index(to)];
  collapse.halfedge = side;
  collapse.place = at(to);
  if (!fixed(to)) {
    const Eigen::Vector3d best = sum.minimum();
    const double length = (at(from) - at(to)).norm();
    const Eigen::Vector3d middle = (at(from) + at(to)) / 2;
    if ((best - middle).norm() <= length) {
      for (int k = 0; k < 3; ++k) collapse.place[k] = TileGrid::snap(best[k]);
      // Nothing new comes to stand on a tile's border.
      collapse.place.head<2>() = collapse.place.head<2>().array().max(low_).min(high_);
    }
  }
  collapse.cost = sum.at(collapse.place);
  return true;
}

bool Decimation::staysWell(VertexHandle vertex, VertexHandle other, const Eigen::Vector3d& place) const {
  for (const HalfedgeHandle out : mesh_.voh_range(vertex)) {
    if (mesh_.is_boundary(out)) continue;
    const VertexHandle b = mesh_.to_vertex_handle(out);
    const VertexHandle c = mesh_.to_vertex_handle(mesh_.next_halfedge_handle(out));
    if (b == other || c == other) continue;
    const Eigen::Vector3d before = areaVector(at(vertex), at(b), at(c)),
                          after = areaVector(place, at(b), at(c));
    const double area_before = before.norm(), area_after = after.norm();
    if (!(area_after > 0)) return false;
    if (after.dot(before) < kTurn * area_after * area_before) return false;
    // Nor against the original faces that it represents, even by many small turns.
    for (const VertexHandle v : {vertex, b, c})
      if (after.dot(facing_[index(v)]) < 0 && before.dot(facing_[index(v)]) >= 0) return false;
    const bool border = fixed(b) && fixed(c);
    const double now = quality(area_after, place, at(b), at(c));
    if (now < (border ? kQualityAtBorder : kQuality) && now < quality(area_before, at(vertex), at(b), at(c)))
      return false;
  }
  return true;
}

bool Decimation::allowed(const Collapse& collapse) {
  if (!mesh_.is_collapse_ok(collapse.halfedge)) return false;
  const VertexHandle from = mesh_.from_vertex_handle(collapse.halfedge);
  const VertexHandle to = mesh_.to_vertex_handle(collapse.halfedge);
  // A new edge between two vertices of one side would be in it, where the neighbour has none.
  if (sides_[index(to)] != 0)
    for (const VertexHandle ring : mesh_.vv_range(from))
      if (ring != to && (sides_[index(ring)] & sides_[index(to)]) != 0 &&
          !mesh_.find_halfedge(ring, to).is_valid())
        return false;
  if (!staysWell(from, to, collapse.place)) return false;
  return collapse.place == at(to) || staysWell(to, from, collapse.place);
}

void Decimation::blend(std::size_t from, std::size_t to, const Eigen::Vector3d& place) {
  const Eigen::Vector3d edge = position_[to] - position_[from];
  const double length2 = edge.squaredNorm();
  const double s = length2 > 0 ? std::clamp(edge.dot(place - position_[from]) / length2, 0.0, 1.0) : 1.0;
  const auto t = static_cast<float>(s);
  if (!sigma_.empty()) sigma_[to] = (1 - t) * sigma_[from] + t * sigma_[to];
  if (!views_.empty()) views_[to] = (1 - t) * views_[from] + t * views_[to];
  if (!colour_.empty()) colour_[to] = (1 - t) * colour_[from] + t * colour_[to];
}

void Decimation::apply(const Collapse& collapse) {
  const std::size_t from = index(mesh_.from_vertex_handle(collapse.halfedge));
  const VertexHandle stays = mesh_.to_vertex_handle(collapse.halfedge);
  const std::size_t to = index(stays);
  faces_ -= mesh_.is_boundary(mesh_.edge_handle(collapse.halfedge)) ? 1 : 2;
  mesh_.collapse(collapse.halfedge);
  if (!fixed(stays)) blend(from, to, collapse.place);
  position_[to] = collapse.place;
  quadric_[to] += quadric_[from];
  facing_[to] += facing_[from];
  for (const HalfedgeHandle out : mesh_.voh_range(stays)) push(mesh_.edge_handle(out));
  ++counts_.collapses;
}

void Decimation::run(std::size_t target_triangles) {
  const std::size_t target = target_triangles - std::min(target_triangles, stranded_.size());
  collapseTo(target);
  // Holes smaller than a triangle are finer than this level's detail; once they are closed, the vertices
  // around them are free.
  constexpr std::size_t kMostEdges = 4;
  const auto mean = [&] { return area_ / static_cast<double>(std::max<std::size_t>(faces_, 1)); };
  while (closeHoles(kMostEdges, mean()) > 0) collapseTo(target);
}

void Decimation::collapseTo(std::size_t target) {
  // Collapses around an edge can make its own valid: repeat while that helps.
  for (std::uint64_t before = counts_.collapses + 1; faces_ > target && before != counts_.collapses;) {
    before = counts_.collapses;
    pushAll();
    while (faces_ > target && !turns_.empty()) {
      const Turn turn = turns_.front();
      std::pop_heap(turns_.begin(), turns_.end());
      turns_.pop_back();
      const EdgeHandle edge(static_cast<int>(turn.edge));
      Collapse collapse;
      if (mesh_.status(edge).deleted() || stamp_[turn.edge] != turn.stamp || !plan(edge, collapse)) continue;
      if (allowed(collapse)) apply(collapse);
    }
  }
}

TileMesh Decimation::result() const {
  TileMesh out;
  out.tile = tile_.tile;
  out.error = tile_.error;
  constexpr std::uint32_t kNone = 0xFFFFFFFF;
  // Copies of a vertex at a cut have not moved and are joined.
  std::vector<std::uint32_t> number(tile_.mesh.vertices.size(), kNone);
  std::vector<std::uint8_t> kept_normal;
  const auto numberOf = [&](std::size_t v) {
    const std::uint32_t old = parts_.original[v];
    if (number[old] != kNone) return number[old];
    number[old] = static_cast<std::uint32_t>(out.mesh.vertices.size());
    out.mesh.vertices.push_back((position_[v] + origin_).cast<float>());
    out.shared.push_back(sides_[v]);
    if (!sigma_.empty()) out.mesh.sigma.push_back(sigma_[v]);
    if (!views_.empty()) out.views.push_back(static_cast<std::uint16_t>(std::lround(views_[v])));
    if (!colour_.empty()) {
      Rgb rgb;
      for (std::size_t c = 0; c < 3; ++c)
        rgb[c] = static_cast<std::uint8_t>(std::lround(colour_[v][static_cast<int>(c)]));
      out.mesh.colours.push_back(rgb);
    }
    return number[old];
  };
  for (const FaceHandle face : mesh_.faces()) {
    std::array<std::uint32_t, 3> t;
    std::size_t k = 0;
    for (const VertexHandle v : mesh_.fv_range(face)) t[k++] = numberOf(index(v));
    out.mesh.triangles.push_back(t);
  }
  for (const auto& [a, b, c] : stranded_)
    out.mesh.triangles.push_back({numberOf(a), numberOf(b), numberOf(c)});
  computeNormals(out.mesh);
  if (!tile_.mesh.normals.empty())
    for (std::size_t old = 0; old < number.size(); ++old)
      if (number[old] != kNone && out.shared[number[old]] != 0)
        out.mesh.normals[number[old]] = tile_.mesh.normals[old];
  return out;
}

}  // namespace fathom::surface

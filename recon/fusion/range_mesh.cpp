#include "recon/fusion/range_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "recon/fusion/cell_statistics.hpp"

namespace fathom::fusion {
namespace {

constexpr std::uint32_t kUnused = 0xFFFFFFFF;
// Least sigma of an observation, in voxels: the grid cannot resolve less.
constexpr double kMinSigma = 0.1;
// Half width of the band in standard deviations, of an observation and between meshes.
constexpr double kBandSigma = 3.0;

bool isUsableScan(const Mesh& mesh, std::uint32_t v) {
  constexpr float kMaxCoordinate = 1e6F;  // [m]: block numbers stay well inside 32 bits
  if (v >= mesh.vertices.size()) return false;
  if (!mesh.vertices[v].allFinite() || mesh.vertices[v].cwiseAbs().maxCoeff() > kMaxCoordinate) return false;
  return mesh.sigma.empty() || (mesh.sigma[v] >= 0 && std::isfinite(mesh.sigma[v]));
}

bool isUsableScan(const Mesh& mesh, const std::array<std::uint32_t, 3>& t, double max_edge) {
  for (const std::uint32_t v : t)
    if (!isUsableScan(mesh, v)) return false;
  for (std::size_t k = 0; k < 3; ++k)
    if ((mesh.vertices[t[k]] - mesh.vertices[t[(k + 1) % 3]]).norm() > static_cast<float>(max_edge))
      return false;
  return true;
}

// Weight at the border, where a mesh must still count without others.
constexpr float kBorderFloor = 0.05F;

// The neighbours of each vertex, twice where two triangles have the edge, in compressed rows.
struct Neighbours {
  std::vector<std::uint32_t> first, vertex;

  explicit Neighbours(const Mesh& mesh) : first(mesh.vertices.size() + 2, 0) {
    for (const auto& t : mesh.triangles)
      for (const std::uint32_t v : t) first[v + 2] += 2;
    for (std::size_t v = 2; v < first.size(); ++v) first[v] += first[v - 1];
    vertex.resize(mesh.triangles.size() * 6);
    for (const auto& [a, b, c] : mesh.triangles) {  // first[v + 1] is where the next neighbour of v goes
      for (const auto& [v, u, w] : {std::array{a, b, c}, std::array{b, c, a}, std::array{c, a, b}}) {
        vertex[first[v + 1]++] = u;
        vertex[first[v + 1]++] = w;
      }
    }
  }
};

// A factor for each vertex: 1 inside, falling linearly to a small floor at the mesh's border over `width` [m]
// (along edges), so that range meshes blend at their ends (Curless & Levoy 1996, section 3.1).
std::vector<float> borderWeights(const Mesh& mesh, double width) {
  const std::size_t n = mesh.vertices.size();
  const auto far = static_cast<float>(width);
  const Neighbours near(mesh);
  std::vector<float> distance(n, far);
  std::vector<std::uint32_t> reached;
  for (std::uint32_t v = 0; v < n; ++v) {
    // A border vertex has a neighbour that only one triangle gives it.
    const auto begin = near.vertex.begin() + near.first[v], end = near.vertex.begin() + near.first[v + 1];
    if (std::any_of(begin, end, [&](std::uint32_t u) { return std::count(begin, end, u) == 1; })) {
      distance[v] = 0;
      reached.push_back(v);
    }
  }
  // Shortest paths along edges from the border, up to the width: a vertex that became nearer updates its
  // neighbours. Lengths are summed in the order of the path, so the result does not depend on the order
  // of updates.
  std::vector<bool> waiting(n, false);
  for (std::size_t k = 0; k < reached.size(); ++k) {
    const std::uint32_t v = reached[k];
    waiting[v] = false;
    for (std::uint32_t i = near.first[v]; i < near.first[v + 1]; ++i) {
      const std::uint32_t u = near.vertex[i];
      const float through = distance[v] + (mesh.vertices[u] - mesh.vertices[v]).norm();
      if (through >= distance[u]) continue;
      distance[u] = through;
      if (!waiting[u]) reached.push_back(u);
      waiting[u] = true;
    }
  }
  for (float& d : distance) d = std::max(kBorderFloor, d / far);
  return distance;
}

// Points flatter to the side than this depth, in parts of their range, are outside the picture.
constexpr float kLeastForward = 0.2F;
constexpr float kFar = std::numeric_limits<float>::infinity();

void set(float (&axis)[3], const Eigen::Vector3f& v) {
  for (int k = 0; k < 3; ++k) axis[k] = v[k];
}
float dot(const float (&axis)[3], const Eigen::Vector3f& v) {
  return (axis[0] * v.x() + axis[1] * v.y()) + axis[2] * v.z();
}

int cellOf(float at) {
  return std::clamp(static_cast<int>(std::floor(at)), 0, SightPicture::kSize - 1);
}

// The least of each value and its two neighbours, `step` apart; beyond the ends nothing is known.
void leastOfThree(const float* from, std::size_t step, float beyond, float* to) {
  constexpr std::size_t kSize = SightPicture::kSize;
  for (std::size_t k = 0; k < kSize; ++k) {
    const float before = k > 0 ? from[(k - 1) * step] : beyond;
    const float after = k + 1 < kSize ? from[(k + 1) * step] : beyond;
    to[k * step] = std::min({before, from[k * step], after});
  }
}

void leastAround(float (&values)[SightPicture::kSize * SightPicture::kSize], float beyond) {
  constexpr std::size_t kSize = SightPicture::kSize;
  std::array<float, kSize * kSize> rows;
  for (std::size_t y = 0; y < kSize; ++y)
    leastOfThree(values + y * kSize, 1, beyond, rows.data() + y * kSize);
  for (std::size_t x = 0; x < kSize; ++x) leastOfThree(rows.data() + x, kSize, beyond, values + x);
}

}  // namespace

std::size_t RangeMesh::set(const Mesh& mesh, const Eigen::Vector3d& centre, const VolumetricConfig& config) {
  vertices.clear();
  points.clear();
  triangles.clear();
  used_.vertices.clear();
  number_.assign(mesh.vertices.size(), kUnused);
  const double max_edge = VolumetricFusion::kMaxEdge * config.voxel;
  for (const auto& t : mesh.triangles) {
    if (!isUsableScan(mesh, t, max_edge)) continue;
    std::array<std::uint32_t, 3> numbers;
    for (std::size_t k = 0; k < 3; ++k) {
      std::uint32_t& number = number_[t[k]];
      if (number == kUnused) {
        number = static_cast<std::uint32_t>(vertices.size());
        Vertex v;
        v.point = mesh.vertices[t[k]].cast<double>() - centre;
        const double sigma = mesh.sigma.empty() ? config.voxel / 2 : static_cast<double>(mesh.sigma[t[k]]);
        v.sigma = static_cast<float>(std::max(sigma, kMinSigma * config.voxel));
        v.colour = mesh.colours.empty() ? kUncolouredRgb : mesh.colours[t[k]];
        vertices.push_back(v);
        points.push_back(v.point.cast<float>());
        used_.vertices.push_back(mesh.vertices[t[k]]);
      }
      numbers[k] = number;
    }
    triangles.push_back(numbers);
  }
  measureRelief();
  used_.triangles = triangles;
  const std::vector<float> border = borderWeights(used_, config.border);
  for (std::size_t k = 0; k < vertices.size(); ++k) {
    Vertex& v = vertices[k];
    v.border = border[k];
    double spread = static_cast<double>(v.sigma);
    if (config.statistics != nullptr) {
      const Eigen::Vector3f& p = used_.vertices[k];
      if (const auto cell = config.statistics->at(static_cast<double>(p.x()), static_cast<double>(p.y())))
        spread = std::max(spread, cell->deviation);
    }
    v.band = static_cast<float>(
        std::clamp(kBandSigma * spread, config.truncation, VolumetricFusion::kMaxBand * config.truncation));
  }
  return mesh.triangles.size() - triangles.size();
}

// Relief: unit normals with a mean of length m have the variance 1 - m^2 about it, that of their
// slopes. Noise along the ray adds sigma^2 sum(l^2) / (2 A)^2 in a triangle of area A with sides l,
// which is subtracted.
void RangeMesh::measureRelief() {
  normal_sum_.assign(vertices.size(), Eigen::Vector3f::Zero());
  area_sum_.assign(vertices.size(), 0.0F);
  noise_sum_.assign(vertices.size(), 0.0F);
  for (const auto& [a, b, c] : triangles) {
    const Eigen::Vector3f ab = points[b] - points[a], ac = points[c] - points[a];
    const Eigen::Vector3f normal = ab.cross(ac);
    const float area = normal.norm();
    const float sides = ab.squaredNorm() + ac.squaredNorm() + (ac - ab).squaredNorm();
    for (const std::uint32_t v : {a, b, c}) {
      const float sigma = vertices[v].sigma;
      normal_sum_[v] += normal;
      area_sum_[v] += area;
      noise_sum_[v] += std::min(area, sigma * sigma * sides / area);
    }
  }
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!(area_sum_[v] > 0)) continue;
    const float spread = 1 - normal_sum_[v].squaredNorm() / (area_sum_[v] * area_sum_[v]);
    vertices[v].relief = std::max(0.0F, spread - noise_sum_[v] / area_sum_[v]);
  }
}

void SightMap::begin(const std::vector<Eigen::Vector3f>& points) {
  Eigen::Vector3f forward = Eigen::Vector3f::Zero();
  for (const Eigen::Vector3f& p : points) forward += p.normalized();
  if (!(forward.norm() > 0)) forward = Eigen::Vector3f::UnitZ();
  forward.normalize();
  const Eigen::Vector3f right = forward.unitOrthogonal();
  set(picture_.right, right);
  set(picture_.down, forward.cross(right));
  set(picture_.forward, forward);
  std::fill(std::begin(picture_.depth), std::end(picture_.depth), kFar);
  std::fill(std::begin(picture_.weight), std::end(picture_.weight), kFar);

  in_view_.assign(points.size(), {});
  Eigen::Array2f least = Eigen::Array2f::Constant(kFar), most = -least;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const float depth = dot(picture_.forward, points[k]);
    if (!(depth > kLeastForward * points[k].norm())) continue;
    in_view_[k] = {dot(picture_.right, points[k]) / depth, dot(picture_.down, points[k]) / depth, depth};
    const Eigen::Array2f at(in_view_[k].column, in_view_[k].row);
    least = least.min(at);
    most = most.max(at);
  }
  const float extent = (most - least).maxCoeff();
  picture_.scale = 0;
  if (!(extent > 0 && std::isfinite(extent))) return;
  picture_.origin[0] = least.x();
  picture_.origin[1] = least.y();
  picture_.scale = static_cast<float>(kSize) / extent;
  for (InView& at : in_view_) {
    at.column = (at.column - picture_.origin[0]) * picture_.scale;
    at.row = (at.row - picture_.origin[1]) * picture_.scale;
  }
}

void SightMap::add(const std::array<std::uint32_t, 3>& corners, float band, float weight) {
  const InView &a = in_view_[corners[0]], &b = in_view_[corners[1]], &c = in_view_[corners[2]];
  const float nearest = std::min({a.depth, b.depth, c.depth});
  if (!(nearest > 0)) return;
  const float depth = nearest - band;
  const int x0 = cellOf(std::min({a.column, b.column, c.column}));
  const int x1 = cellOf(std::max({a.column, b.column, c.column}));
  const int y0 = cellOf(std::min({a.row, b.row, c.row})), y1 = cellOf(std::max({a.row, b.row, c.row}));
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const int at = y * kSize + x;
      picture_.depth[at] = std::min(picture_.depth[at], depth);
      picture_.weight[at] = std::min(picture_.weight[at], weight);
    }
  }
}

void SightMap::close() {
  for (float& depth : picture_.depth) depth = depth < kFar && picture_.scale > 0 ? depth : -kFar;
  leastAround(picture_.depth, -kFar);
  leastAround(picture_.weight, 0);
}

bool SightMap::surelyUnknown(const Eigen::Vector3f& middle, float radius) const {
  const float depth = dot(picture_.forward, middle);
  const float nearest = depth - radius;
  if (picture_.scale <= 0) return true;
  if (!(nearest > kLeastForward * middle.norm())) return false;
  // x / z of the ball differs at most by this from its middle's.
  const Eigen::Array2f at(dot(picture_.right, middle) / depth, dot(picture_.down, middle) / depth);
  const float around = radius * (1 + at.abs().maxCoeff()) / nearest;
  const Eigen::Array2f cell = (at - Eigen::Array2f(picture_.origin[0], picture_.origin[1])) * picture_.scale;
  const float reach = around * picture_.scale + 1;
  const auto size = static_cast<float>(kSize);
  if ((cell + reach < 0).any() || (cell - reach > size).any()) return true;
  const int x0 = cellOf(cell.x() - reach), x1 = cellOf(cell.x() + reach);
  const int y0 = cellOf(cell.y() - reach), y1 = cellOf(cell.y() + reach);
  float most = -kFar;
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) most = std::max(most, picture_.depth[y * kSize + x]);
  return most <= nearest;
}

}  // namespace fathom::fusion

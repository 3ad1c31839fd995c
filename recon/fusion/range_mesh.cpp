#include "recon/fusion/range_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "recon/fusion/cell_statistics.hpp"
#include "recon/geometry/mesh.hpp"

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

}  // namespace fathom::fusion

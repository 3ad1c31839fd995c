#include "recon/fusion/range_mesh.hpp"

#include <algorithm>
#include <cmath>

#include "recon/fusion/border_weight.hpp"
#include "recon/fusion/cell_statistics.hpp"

namespace fathom::fusion {
namespace {

constexpr std::uint32_t kUnused = 0xFFFFFFFF;
constexpr Rgb kNoColour = {128, 128, 128};
// Finest observation that is believed, in voxels: the grid cannot show more.
constexpr double kMinSigma = 0.1;
// Half width of the band in standard deviations, of an observation and between meshes.
constexpr double kBandSigma = 3.0;

bool usable(const Mesh& mesh, std::uint32_t v) {
  constexpr float kMaxCoordinate = 1e6F;  // [m]: block numbers stay well inside 32 bits
  if (v >= mesh.vertices.size()) return false;
  if (!mesh.vertices[v].allFinite() || mesh.vertices[v].cwiseAbs().maxCoeff() > kMaxCoordinate) return false;
  return mesh.sigma.empty() || (mesh.sigma[v] >= 0 && std::isfinite(mesh.sigma[v]));
}

bool usable(const Mesh& mesh, const std::array<std::uint32_t, 3>& t, double max_edge) {
  for (const std::uint32_t v : t)
    if (!usable(mesh, v)) return false;
  for (std::size_t k = 0; k < 3; ++k)
    if ((mesh.vertices[t[k]] - mesh.vertices[t[(k + 1) % 3]]).norm() > static_cast<float>(max_edge))
      return false;
  return true;
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
    if (!usable(mesh, t, max_edge)) continue;
    std::array<std::uint32_t, 3> numbers;
    for (std::size_t k = 0; k < 3; ++k) {
      std::uint32_t& number = number_[t[k]];
      if (number == kUnused) {
        number = static_cast<std::uint32_t>(vertices.size());
        Vertex v;
        v.point = mesh.vertices[t[k]].cast<double>() - centre;
        const double sigma = mesh.sigma.empty() ? config.voxel / 2 : static_cast<double>(mesh.sigma[t[k]]);
        v.sigma = static_cast<float>(std::max(sigma, kMinSigma * config.voxel));
        v.colour = mesh.colours.empty() ? kNoColour : mesh.colours[t[k]];
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

// Unit normals whose mean has the length m spread about it by 1 - m^2: the square of their slopes. Noise
// along the ray does that too: in a triangle of area A with sides l by sigma^2 sum(l^2) / (2 A)^2.
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

#include "recon/fusion/volumetric_fusion.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "recon/fusion/border_weight.hpp"
#include "recon/fusion/sight_map.hpp"
#include "recon/fusion/volumetric_impl.hpp"

namespace fathom::fusion {
namespace {

constexpr int kEdge = VoxelBlock::kEdge;
constexpr Rgb kNoColour = {128, 128, 128};
// Finest observation that is believed, in voxels: the grid cannot show more.
constexpr double kMinSigma = 0.1;
// Widest band, in truncations, and its half width in sigma where that is more than the truncation.
constexpr double kMaxBand = 3.0, kBandSigma = 3.0;
// Surfaces seen at a flatter angle (cosine) are left out: their distances along the ray say little.
constexpr double kMinIncidence = 0.05;

int floorDiv(int a) {
  return a >> 3;
}  // by kEdge
static_assert(kEdge == 8);

struct Observation {
  double distance, weight;
  std::array<double, 3> colour;
};

void update(VoxelBlock& block, std::size_t at, const Observation& seen) {
  const double total = static_cast<double>(block.weight[at]) + seen.weight;
  const double share = seen.weight / total;
  block.distance[at] += static_cast<float>(share * (seen.distance - static_cast<double>(block.distance[at])));
  block.weight[at] = static_cast<float>(total);
  for (std::size_t c = 0; c < 3; ++c) {
    const double old = block.colour[c][at];
    block.colour[c][at] = static_cast<std::uint16_t>(old + share * (seen.colour[c] * 256.0 - old) + 0.5);
  }
  if (block.observations[at] < 0xFFFF) ++block.observations[at];
}

// One triangle seen from the camera centre, which is the origin here. The ray through p meets the triangle
// inside when (v1 x v2) . p and its like have one sign; those are also the (unnormalised) weights of the
// corners at that point.
struct SightTriangle {
  std::array<Eigen::Vector3d, 3> corner;
  std::array<Eigen::Vector3d, 3> side;  // of the edge opposite to the corner
  std::array<bool, 3> owns;             // rays exactly through an edge belong to one of its triangles
  Eigen::Vector3d normal;               // not normalised
  double plane = 0;                     // normal . corner, negative when it faces the camera

  SightTriangle(const Mesh& mesh, const std::array<std::uint32_t, 3>& t, const Eigen::Vector3d& centre) {
    for (std::size_t k = 0; k < 3; ++k) corner[k] = mesh.vertices[t[k]].cast<double>() - centre;
    for (std::size_t k = 0; k < 3; ++k) {
      // Computed the same way for both triangles of an edge, so that they agree to the last bit.
      const std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
      owns[k] = t[a] < t[b];
      side[k] = owns[k] ? corner[b].cross(corner[a]).eval() : Eigen::Vector3d(-corner[a].cross(corner[b]));
    }
    normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
    plane = normal.dot(corner[0]);
  }

  bool weights(const Eigen::Vector3d& p, std::array<double, 3>& w) const {
    for (std::size_t k = 0; k < 3; ++k) {
      w[k] = side[k].dot(p);
      if (!(w[k] > 0 || (w[k] == 0 && owns[k]))) return false;
    }
    return true;
  }
};

bool usable(const Mesh& mesh, const std::array<std::uint32_t, 3>& t, double max_edge) {
  constexpr float kMaxCoordinate = 1e6F;  // [m]: block numbers stay well inside 32 bits
  for (const std::uint32_t v : t) {
    if (v >= mesh.vertices.size()) return false;
    if (!mesh.vertices[v].allFinite() || mesh.vertices[v].cwiseAbs().maxCoeff() > kMaxCoordinate)
      return false;
    if (!mesh.sigma.empty() && !(mesh.sigma[v] >= 0 && std::isfinite(mesh.sigma[v]))) return false;
  }
  for (std::size_t k = 0; k < 3; ++k)
    if ((mesh.vertices[t[k]] - mesh.vertices[t[(k + 1) % 3]]).norm() > static_cast<float>(max_edge))
      return false;
  return true;
}

// Calls visit(block key, local index, voxel centre) for the voxels of a box [m, nav] within limits.
template <typename Visit>
void voxelsOf(const Eigen::Vector3d& low, const Eigen::Vector3d& high, double voxel,
              const BlockLimits& limits, Visit&& visit) {
  const Eigen::Vector3i lo = (low / voxel).array().ceil().cast<int>();
  const Eigen::Vector3i hi = (high / voxel).array().floor().cast<int>();
  for (int bx = std::max(floorDiv(lo.x()), limits.x0); bx <= std::min(floorDiv(hi.x()), limits.x1 - 1);
       ++bx) {
    for (int by = std::max(floorDiv(lo.y()), limits.y0); by <= std::min(floorDiv(hi.y()), limits.y1 - 1);
         ++by) {
      for (int bz = floorDiv(lo.z()); bz <= floorDiv(hi.z()); ++bz) {
        const BlockKey key{bx, by, bz};
        for (int x = std::max(lo.x(), bx * kEdge); x <= std::min(hi.x(), bx * kEdge + kEdge - 1); ++x)
          for (int y = std::max(lo.y(), by * kEdge); y <= std::min(hi.y(), by * kEdge + kEdge - 1); ++y)
            for (int z = std::max(lo.z(), bz * kEdge); z <= std::min(hi.z(), bz * kEdge + kEdge - 1); ++z)
              visit(key, VoxelBlock::local(x & 7, y & 7, z & 7),
                    Eigen::Vector3d(x * voxel, y * voxel, z * voxel));
      }
    }
  }
}

// Gives the voxels that `sight` saw through an observation of free space; their colours stay. Only blocks
// that hold something are looked at: the grid does not grow.
template <typename FindBlocks>
std::uint64_t carveBlocks(const FindBlocks& blocks, const SightMap& sight, const Eigen::Vector3d& centre,
                          const VolumetricConfig& config) {
  std::uint64_t carved = 0;
  blocks([&](const BlockKey& key, VoxelBlock& block) {
    for (std::size_t k = 0; k < VoxelBlock::kVoxels; ++k) {
      if (block.weight[k] <= 0) continue;
      const auto n = static_cast<int>(k);
      const Eigen::Vector3d at(key.x * kEdge + (n >> 6), key.y * kEdge + (n >> 3 & 7),
                               key.z * kEdge + (n & 7));
      const double weight = sight.emptyWeight(at * config.voxel - centre);
      if (weight <= 0) continue;
      const double total = static_cast<double>(block.weight[k]) + weight;
      block.distance[k] +=
          static_cast<float>(weight / total * (config.truncation - static_cast<double>(block.distance[k])));
      block.weight[k] = static_cast<float>(total);
      ++carved;
    }
  });
  return carved;
}

BlockLimits limitsOf(const FusionBounds& bounds, const VolumetricConfig& config) {
  if (bounds.grid.voxel != config.voxel) throw std::invalid_argument("fusion: bounds of another voxel");
  if (bounds.grid.leaf_voxels < kEdge || bounds.grid.leaf_voxels % kEdge != 0)
    throw std::invalid_argument("fusion: tiles are to be a multiple of 8 voxels wide");
  if (bounds.core.empty()) throw std::invalid_argument("fusion: bounds without tiles");
  const int tile = bounds.grid.leaf_voxels / kEdge;
  const int around = static_cast<int>(std::ceil(config.overlap / (config.voxel * kEdge)));
  return {bounds.core.x0 * tile - around, bounds.core.y0 * tile - around, bounds.core.x1 * tile + around,
          bounds.core.y1 * tile + around};
}

}  // namespace

VolumetricFusion::VolumetricFusion(const VolumetricConfig& config) : impl_(std::make_unique<Impl>()) {
  if (!(config.voxel > 1e-5 && config.voxel < 100))
    throw std::invalid_argument("fusion: voxel must be between 0.00001 and 100 m");
  if (!(config.truncation >= config.voxel && config.truncation <= 32 * config.voxel))
    throw std::invalid_argument("fusion: truncation must be between 1 and 32 voxels");
  if (config.min_observations < 1 || config.min_observations > 1000)
    throw std::invalid_argument("fusion: min_observations must be between 1 and 1000");
  if (!(config.border > 0)) throw std::invalid_argument("fusion: border must be positive");
  if (!(config.min_area >= 0)) throw std::invalid_argument("fusion: min_area must not be negative");
  impl_->config = config;
  // What a mesh outside the overlap could still change lies further off than a part that may be dropped.
  if (!(config.overlap / 2 >= reach() + 2 * config.voxel))
    throw std::invalid_argument("fusion: overlap must be more than twice the reach of a mesh");
  if (config.bounds) impl_->limits = limitsOf(*config.bounds, config);
}

double VolumetricFusion::reach() const {
  // Carving looks at whole blocks.
  return std::max(kMaxBand * impl_->config.truncation, kEdge * impl_->config.voxel);
}

VolumetricFusion::~VolumetricFusion() = default;

void VolumetricFusion::integrate(const Mesh& mesh, const Eigen::Vector3d& centre) {
  const VolumetricConfig& config = impl_->config;
  Counters& counters = impl_->counters;
  ++counters.meshes;
  Mesh checked;  // only the triangles that can be used, for what looks at the mesh as a whole
  checked.vertices = mesh.vertices;
  for (const auto& t : mesh.triangles) {
    if (usable(mesh, t, kMaxEdge * config.voxel))
      checked.triangles.push_back(t);
    else
      ++counters.skipped_triangles;
  }
  if (checked.triangles.empty() || !centre.allFinite()) return;
  const std::vector<float> border = borderWeights(checked, config.border);
  SightMap sight(checked, centre);

  VoxelBlock* block = nullptr;
  BlockKey block_key{};
  for (const auto& t : checked.triangles) {
    const SightTriangle triangle(mesh, t, centre);
    const double area2 = triangle.normal.norm();
    const double range = ((triangle.corner[0] + triangle.corner[1] + triangle.corner[2]) / 3).norm();
    const double incidence = -triangle.plane / (area2 * range);
    if (!(incidence > kMinIncidence)) {
      ++counters.skipped_triangles;
      continue;
    }
    ++counters.triangles;
    std::array<double, 3> sigma;
    double widest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      sigma[k] = mesh.sigma.empty() ? config.voxel / 2 : static_cast<double>(mesh.sigma[t[k]]);
      sigma[k] = std::max(sigma[k], kMinSigma * config.voxel);
      widest = std::max(widest, sigma[k]);
    }
    const double band = std::clamp(kBandSigma * widest, config.truncation, kMaxBand * config.truncation);

    Eigen::Vector3d low = Eigen::Vector3d::Constant(INFINITY), high = -low;
    for (const Eigen::Vector3d& v : triangle.corner) {
      const Eigen::Vector3d along = v.normalized() * band;
      for (const Eigen::Vector3d& end : {Eigen::Vector3d(v - along), Eigen::Vector3d(v + along)}) {
        low = low.cwiseMin(end);
        high = high.cwiseMax(end);
      }
    }
    voxelsOf(low + centre, high + centre, config.voxel, impl_->limits,
             [&](const BlockKey& key, std::size_t local, const Eigen::Vector3d& voxel_centre) {
               const Eigen::Vector3d p = voxel_centre - centre;
               std::array<double, 3> w;
               if (!triangle.weights(p, w)) return;
               const double to_surface = triangle.plane / triangle.normal.dot(p);
               const double distance = (to_surface - 1) * p.norm();
               if (!(std::abs(distance) < band)) return;
               const double sum = w[0] + w[1] + w[2];
               double s = 0, edge_weight = 0;
               Observation seen{distance, 0, {}};
               for (std::size_t k = 0; k < 3; ++k) {
                 const double share = w[k] / sum;
                 s += share * sigma[k];
                 edge_weight += share * static_cast<double>(border[t[k]]);
                 const Rgb rgb = mesh.colours.empty() ? kNoColour : mesh.colours[t[k]];
                 for (std::size_t c = 0; c < 3; ++c) seen.colour[c] += share * rgb[c];
               }
               // Behind the surface the weight falls to nothing over the second half of the band, so that the
               // far side of a thin thing is left to those who see it.
               const double behind = std::clamp(2 * (1 + distance / band), 0.0, 1.0);
               seen.weight = edge_weight * incidence * behind / (s * s);
               if (!(seen.weight > 0)) return;
               if (block == nullptr || key != block_key) {
                 block = &impl_->grid.make(key);
                 block_key = key;
               }
               update(*block, local, seen);
               ++counters.voxel_updates;
             });
    sight.add(triangle.corner, band, 1 / (widest * widest));
  }
  if (config.carve) {
    sight.close();
    impl_->carve(sight, centre);
  }
  counters.blocks = impl_->grid.keys().size();
}

void VolumetricFusion::Impl::carve(const SightMap& sight, const Eigen::Vector3d& centre) {
  const double block_size = config.voxel * kEdge;
  const Eigen::Array3d lo = ((sight.low() + centre) / block_size).array().floor();
  const Eigen::Array3d hi = ((sight.high() + centre) / block_size).array().floor();
  const auto inBox = [&](const BlockKey& k) {
    const Eigen::Array3d at(k.x, k.y, k.z);
    return (at >= lo).all() && (at <= hi).all();
  };
  // Whichever is less to look at: the blocks there are, or the places in the box.
  const bool few_places = (hi - lo + 1).prod() < static_cast<double>(grid.keys().size());
  counters.carved_voxels += carveBlocks(
      [&](const auto& visit) {
        if (!few_places) {
          for (const BlockKey& key : grid.keys())
            if (inBox(key)) visit(key, *grid.find(key));
          return;
        }
        for (int x = static_cast<int>(lo.x()); x <= static_cast<int>(hi.x()); ++x)
          for (int y = static_cast<int>(lo.y()); y <= static_cast<int>(hi.y()); ++y)
            for (int z = static_cast<int>(lo.z()); z <= static_cast<int>(hi.z()); ++z)
              if (VoxelBlock* block = grid.find({x, y, z})) visit(BlockKey{x, y, z}, *block);
      },
      sight, centre, config);
}

std::size_t VolumetricFusion::memoryBytes() const {
  return sizeof(Impl) + impl_->grid.memoryBytes();
}

VolumetricFusion::Counters VolumetricFusion::counters() const {
  return impl_->counters;
}

}  // namespace fathom::fusion

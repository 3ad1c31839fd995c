#include "recon/fusion/volumetric_fusion.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include "realtime/base/numbers/union_find.hpp"
#include "recon/fusion/kernels/fusion_kernels.hpp"
#include "recon/fusion/range_mesh.hpp"
#include "recon/fusion/surface_extraction.hpp"
#include "recon/fusion/voxel_grid.hpp"

namespace fathom::fusion {

// Blocks that are kept, in plan: [x0, x1) and [y0, y1).
struct BlockLimits {
  std::int32_t x0 = std::numeric_limits<std::int32_t>::min(), y0 = x0;
  std::int32_t x1 = std::numeric_limits<std::int32_t>::max(), y1 = x1;
};

namespace {

// Surfaces seen at a flatter angle (cosine) are left out: their distances along the ray are inaccurate.
constexpr double kMinIncidence = 0.05;
// Margin of boxes for rounding [voxels].
constexpr double kMargin = 1e-3;

static_assert(kBlockEdge == 8);
int blockOf(int voxel) {
  return voxel >> 3;
}

BlockLimits limitsOf(const FusionBounds& bounds, const VolumetricConfig& config) {
  if (bounds.grid.voxel != config.voxel) throw std::invalid_argument("fusion: bounds of another voxel");
  if (bounds.grid.leaf_voxels < kBlockEdge || bounds.grid.leaf_voxels % kBlockEdge != 0)
    throw std::invalid_argument("fusion: tiles are to be a multiple of 8 voxels wide");
  if (bounds.core.empty()) throw std::invalid_argument("fusion: bounds without tiles");
  const int tile = bounds.grid.leaf_voxels / kBlockEdge;
  const int around = static_cast<int>(std::ceil(config.overlap / (config.voxel * kBlockEdge)));
  return {bounds.core.x0 * tile - around, bounds.core.y0 * tile - around, bounds.core.x1 * tile + around,
          bounds.core.y1 * tile + around};
}

// The places of one block's voxels relative to the camera centre.
struct BlockPlaces {
  float x[kBlockEdge], y[kBlockEdge], z[kBlockEdge];

  BlockPlaces(const VoxelBlockKey& key, double voxel, const Eigen::Vector3d& centre) {
    fill(x, key.x, voxel, centre.x());
    fill(y, key.y, voxel, centre.y());
    fill(z, key.z, voxel, centre.z());
  }
  static void fill(float (&to)[kBlockEdge], int block, double voxel, double centre) {
    for (int k = 0; k < kBlockEdge; ++k)
      to[k] = static_cast<float>((block * kBlockEdge + k) * voxel - centre);
  }
};

struct Corners {
  std::array<const RangeMesh::Vertex*, 3> vertex;
  Eigen::Vector3d normal;  // not normalised
  double incidence = 0;    // cosine
  float band = 0, sigma = 0;

  Corners(const RangeMesh& mesh, const std::array<std::uint32_t, 3>& t)
      : vertex{&mesh.vertices[t[0]], &mesh.vertices[t[1]], &mesh.vertices[t[2]]} {
    const Eigen::Vector3d &a = point(0), &b = point(1), &c = point(2);
    normal = (b - a).cross(c - a);
    incidence = -normal.dot(a) / (normal.norm() * ((a + b + c) / 3).norm());
    for (const RangeMesh::Vertex* v : vertex) {
      band = std::max(band, v->band);
      sigma = std::max(sigma, v->sigma);
    }
  }
  [[nodiscard]] const Eigen::Vector3d& point(std::size_t k) const { return vertex[k]->point; }
};

SightTriangle termsOf(const Corners& corners, const std::array<std::uint32_t, 3>& t) {
  SightTriangle out;
  const float relief =
      (corners.vertex[0]->relief + corners.vertex[1]->relief + corners.vertex[2]->relief) / 3;
  for (std::size_t k = 0; k < 3; ++k) {
    // Computed equally for both triangles of an edge, so that they agree to the last bit.
    const std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
    const bool owns = t[a] < t[b];
    const Eigen::Vector3d side = owns ? corners.point(b).cross(corners.point(a)).eval()
                                      : Eigen::Vector3d(-corners.point(a).cross(corners.point(b)));
    out.owns[k] = owns ? -1 : 0;
    const RangeMesh::Vertex& v = *corners.vertex[k];
    out.weight[k] = static_cast<float>(corners.incidence) * v.border;
    out.variance[k] = v.sigma * v.sigma;
    // A random walk between its ends, with the steps that the slopes around show.
    out.between[k] = relief * static_cast<float>((corners.point(b) - corners.point(a)).squaredNorm());
    for (std::size_t c = 0; c < 3; ++c) {
      out.side[k][c] = static_cast<float>(side[static_cast<int>(c)]);
      out.colour[k][c] = 256.0F * v.colour[c];
      if (k == 0) out.scale[c] = static_cast<float>(-corners.normal[static_cast<int>(c)]);
    }
  }
  out.plane = static_cast<float>(-corners.normal.dot(corners.point(0)));
  out.band = corners.band;
  return out;
}

constexpr std::uint32_t kNoNumber = 0xFFFFFFFF;

// For each triangle whether its part is smaller than `size` along every axis and less than `area`.
std::vector<bool> smallParts(const Mesh& mesh, double size, double area) {
  struct Extent {
    Eigen::Vector3f low = Eigen::Vector3f::Constant(INFINITY), high = -low;
    double area = 0;
  };
  UnionFind parts(mesh.vertices.size());
  for (const auto& t : mesh.triangles) {
    parts.join(t[0], t[1]);
    parts.join(t[0], t[2]);
  }
  std::vector<std::uint32_t> number(mesh.vertices.size(), kNoNumber);
  std::vector<Extent> extents;
  std::vector<std::uint32_t> part_of(mesh.triangles.size());
  for (std::size_t k = 0; k < mesh.triangles.size(); ++k) {
    const auto& [a, b, c] = mesh.triangles[k];
    std::uint32_t& part = number[parts.root(a)];
    if (part == kNoNumber) {
      part = static_cast<std::uint32_t>(extents.size());
      extents.emplace_back();
    }
    part_of[k] = part;
    Extent& extent = extents[part];
    for (const std::uint32_t v : {a, b, c}) {
      extent.low = extent.low.cwiseMin(mesh.vertices[v]);
      extent.high = extent.high.cwiseMax(mesh.vertices[v]);
    }
    const Eigen::Vector3f ab = mesh.vertices[b] - mesh.vertices[a], ac = mesh.vertices[c] - mesh.vertices[a];
    extent.area += 0.5 * static_cast<double>(ab.cross(ac).norm());
  }
  std::vector<bool> small(mesh.triangles.size());
  for (std::size_t k = 0; k < small.size(); ++k) {
    const Extent& extent = extents[part_of[k]];
    small[k] = extent.area < area && static_cast<double>((extent.high - extent.low).maxCoeff()) < size;
  }
  return small;
}

int floorDiv(int a, int b) {
  return a >= 0 ? a / b : -((-a + b - 1) / b);
}

// Takes the triangles of one tile out of a surface.
class TileCut {
 public:
  TileCut(const ExtractedSurface& surface, int blocks)
      : surface_(surface), blocks_(blocks), taken_(surface.mesh.vertices.size()) {}

  TileMesh cut(const TileId& id, const std::vector<std::uint32_t>& parts, const std::vector<bool>& left_out) {
    ++turn_;
    TileMesh out;
    out.tile = id;
    const auto& triangles = surface_.mesh.triangles;
    for (const std::uint32_t part : parts) {
      const std::size_t end =
          part + 1 < surface_.parts.size() ? surface_.parts[part + 1].first_triangle : triangles.size();
      for (std::size_t k = surface_.parts[part].first_triangle; k < end; ++k)
        if (!left_out[k])
          out.mesh.triangles.push_back(
              {take(triangles[k][0], out), take(triangles[k][1], out), take(triangles[k][2], out)});
    }
    return out;
  }

 private:
  std::uint32_t take(std::uint32_t v, TileMesh& out) {
    if (taken_[v].turn == turn_) return taken_[v].as;
    taken_[v] = {turn_, static_cast<std::uint32_t>(out.mesh.vertices.size())};
    out.mesh.vertices.push_back(surface_.mesh.vertices[v]);
    out.mesh.normals.push_back(surface_.mesh.normals[v]);
    out.mesh.colours.push_back(surface_.mesh.colours[v]);
    out.mesh.sigma.push_back(surface_.mesh.sigma[v]);
    out.views.push_back(surface_.views[v]);
    const VoxelBlockKey& home = surface_.parts[surface_.home[v]].block;
    unsigned sides = 0;
    if ((surface_.planes[v] & 1) != 0) {
      if (home.x == out.tile.x * blocks_) sides |= kLowNorth;
      if (home.x == (out.tile.x + 1) * blocks_) sides |= kHighNorth;
    }
    if ((surface_.planes[v] & 2) != 0) {
      if (home.y == out.tile.y * blocks_) sides |= kLowEast;
      if (home.y == (out.tile.y + 1) * blocks_) sides |= kHighEast;
    }
    out.shared.push_back(static_cast<std::uint8_t>(sides));
    return taken_[v].as;
  }

  const ExtractedSurface& surface_;
  int blocks_;  // along a tile's side
  struct Taken {
    std::uint32_t turn = 0, as = 0;  // in which cut, as which vertex
  };
  std::vector<Taken> taken_;
  std::uint32_t turn_ = 0;
};

}  // namespace

// State of a VolumetricFusion.
struct VolumetricFusion::Impl {
  // Adds one triangle of `range_mesh`; false: it is seen too flat or from behind.
  bool fuse(const std::array<std::uint32_t, 3>& triangle, const Eigen::Vector3d& centre);
  // Empties the voxels that a mesh was seen through.
  void carve(const Eigen::Vector3d& centre);

  VolumetricConfig config;
  const FusionKernels* kernels = nullptr;
  BlockLimits limits;
  VoxelGrid grid;
  Counters counters;
  RangeMesh range_mesh;  // of the current mesh, as is `sight`
  SightMap sight;
};

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
  impl_->kernels = config.baseline_kernels ? &baselineFusionKernels() : &fastestFusionKernels();
  if (!config.bounds) return;
  // A mesh outside the overlap changes only voxels farther away than the size of a part that may be dropped.
  if (!(config.overlap / 2 >= reach() + 2 * config.voxel))
    throw std::invalid_argument("fusion: overlap must be more than twice the reach of a mesh");
  impl_->limits = limitsOf(*config.bounds, config);
}

VolumetricFusion::~VolumetricFusion() = default;

double VolumetricFusion::reach() const {
  // Carving processes whole blocks.
  return std::max(kMaxBand * impl_->config.truncation, kBlockEdge * impl_->config.voxel);
}

void VolumetricFusion::integrate(const Mesh& mesh, const Eigen::Vector3d& centre) {
  Counters& counters = impl_->counters;
  ++counters.meshes;
  if (!centre.allFinite()) return;
  RangeMesh& range_mesh = impl_->range_mesh;
  counters.skipped_triangles += range_mesh.set(mesh, centre, impl_->config);
  if (range_mesh.triangles.empty()) return;
  if (impl_->config.carve) impl_->sight.begin(range_mesh.points);
  for (const auto& t : range_mesh.triangles)
    ++(impl_->fuse(t, centre) ? counters.triangles : counters.skipped_triangles);
  if (impl_->config.carve) {
    impl_->sight.close();
    impl_->carve(centre);
  }
  counters.blocks = impl_->grid.keys().size();
}

bool VolumetricFusion::Impl::fuse(const std::array<std::uint32_t, 3>& t, const Eigen::Vector3d& centre) {
  const Corners corners(range_mesh, t);
  if (!(corners.incidence > kMinIncidence)) return false;
  if (config.carve) sight.add(t, corners.band, 1 / (corners.sigma * corners.sigma));

  Eigen::Array3d low = Eigen::Array3d::Constant(INFINITY), high = -low;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Array3d p = corners.point(k);
    const Eigen::Array3d along = p * (static_cast<double>(corners.band) / corners.point(k).norm());
    low = low.min(p - along).min(p + along);
    high = high.max(p - along).max(p + along);
  }
  const Eigen::Array3i first = ((low + centre.array()) / config.voxel - kMargin).ceil().cast<int>();
  const Eigen::Array3i last = ((high + centre.array()) / config.voxel + kMargin).floor().cast<int>();
  const SightTriangle triangle = termsOf(corners, t);
  const int x1 = std::min(blockOf(last.x()), limits.x1 - 1), y1 = std::min(blockOf(last.y()), limits.y1 - 1);
  for (int x = std::max(blockOf(first.x()), limits.x0); x <= x1; ++x) {
    for (int y = std::max(blockOf(first.y()), limits.y0); y <= y1; ++y) {
      for (int z = blockOf(first.z()); z <= blockOf(last.z()); ++z) {
        const VoxelBlockKey key{x, y, z};
        const BlockPlaces places(key, config.voxel, centre);
        const BlockVoxels voxels{places.x,
                                 places.y,
                                 places.z,
                                 std::max(first.x() - x * kBlockEdge, 0),
                                 std::min(last.x() - x * kBlockEdge + 1, kBlockEdge),
                                 std::max(first.y() - y * kBlockEdge, 0),
                                 std::min(last.y() - y * kBlockEdge + 1, kBlockEdge)};
        VoxelBlock* block = grid.find(key);
        if (block == nullptr && kernels->fuse(triangle, voxels, nullptr) > 0) block = &grid.make(key);
        if (block != nullptr)
          counters.voxel_updates += static_cast<std::uint64_t>(kernels->fuse(triangle, voxels, block));
      }
    }
  }
  return true;
}

// Visits existing blocks in the box of the mesh and the camera: the grid does not grow.
void VolumetricFusion::Impl::carve(const Eigen::Vector3d& centre) {
  Eigen::Array3f low(INFINITY, INFINITY, 0), high(-INFINITY, -INFINITY, 0);
  for (const Eigen::Vector3f& p : range_mesh.points) {
    low = low.min(p.array());
    high = high.max(p.array());
  }
  const double block_size = config.voxel * kBlockEdge;
  const Eigen::Array3i lo = ((low.cast<double>() + centre.array()) / block_size).floor().cast<int>();
  const Eigen::Array3i hi = ((high.cast<double>() + centre.array()) / block_size).floor().cast<int>();
  const float radius = static_cast<float>(0.5 * std::sqrt(3.0) * (kBlockEdge - 1) * config.voxel);
  const auto carveBlock = [&](const VoxelBlockKey& key, VoxelBlock& block) {
    const BlockPlaces places(key, config.voxel, centre);
    const Eigen::Vector3f middle(places.x[0] + places.x[kBlockEdge - 1],
                                 places.y[0] + places.y[kBlockEdge - 1],
                                 places.z[0] + places.z[kBlockEdge - 1]);
    if (sight.surelyUnknown(middle / 2, radius)) return;
    counters.carved_voxels += static_cast<std::uint64_t>(
        kernels->carve(sight.picture(), {places.x, places.y, places.z, 0, kBlockEdge, 0, kBlockEdge},
                       static_cast<float>(config.truncation), block));
  };
  const auto inBox = [&](const VoxelBlockKey& k) {
    const Eigen::Array3i at(k.x, k.y, k.z);
    return (at >= lo).all() && (at <= hi).all();
  };
  // Iterates over the fewer: all blocks of the grid, or the places in the box.
  if ((hi - lo + 1).cast<double>().prod() >= static_cast<double>(grid.keys().size())) {
    for (std::uint32_t k = 0; k < grid.keys().size(); ++k)
      if (inBox(grid.keys()[k])) carveBlock(grid.keys()[k], grid.block(k));
    return;
  }
  for (int x = lo.x(); x <= hi.x(); ++x)
    for (int y = lo.y(); y <= hi.y(); ++y)
      for (int z = lo.z(); z <= hi.z(); ++z)
        if (VoxelBlock* block = grid.find({x, y, z})) carveBlock({x, y, z}, *block);
}

std::size_t VolumetricFusion::memoryBytes() const {
  return sizeof(Impl) + impl_->grid.memoryBytes();
}

VolumetricFusion::Counters VolumetricFusion::counters() const {
  return impl_->counters;
}

Mesh VolumetricFusion::extract() const {
  const VolumetricConfig& config = impl_->config;
  return extractSurface(impl_->grid, {config.voxel, config.min_observations, false}).mesh;
}

std::vector<TileMesh> VolumetricFusion::extractTiles(const TileGrid& grid, int halo) const {
  constexpr double kLeastSteps = 8;  // of the lattice a voxel: room for a vertex inside its edges
  const VolumetricConfig& config = impl_->config;
  if (grid.voxel != config.voxel) throw std::invalid_argument("fusion: tiles of another voxel");
  if (grid.leaf_voxels < kBlockEdge || grid.leaf_voxels % kBlockEdge != 0)
    throw std::invalid_argument("fusion: tiles are to be a multiple of 8 voxels wide");
  if (config.voxel < kLeastSteps * TileGrid::kLattice)
    throw std::invalid_argument("fusion: voxels of tiles are to be at least 0.0039 m");
  const ExtractedSurface surface = extractSurface(impl_->grid, {config.voxel, config.min_observations, true});
  const std::vector<bool> left_out = smallParts(surface.mesh, config.overlap / 2, config.min_area);

  const int blocks = grid.leaf_voxels / kBlockEdge;
  std::map<TileId, std::vector<std::uint32_t>> parts_of;
  for (std::uint32_t k = 0; k < surface.parts.size(); ++k) {
    const VoxelBlockKey& key = surface.parts[k].block;
    const TileId tile{0, floorDiv(key.x, blocks), floorDiv(key.y, blocks)};
    if (config.bounds) {
      const TileRange& core = config.bounds->core;
      const TileRange wanted{core.x0 - halo, core.y0 - halo, core.x1 + halo, core.y1 + halo};
      if (!wanted.contains(tile)) continue;
    }
    parts_of[tile].push_back(k);
  }
  std::vector<TileMesh> out;
  TileCut cutter(surface, blocks);
  for (const auto& [tile, parts] : parts_of) {
    TileMesh mesh = cutter.cut(tile, parts, left_out);
    if (!mesh.mesh.empty()) out.push_back(std::move(mesh));
  }
  return out;
}

}  // namespace fathom::fusion

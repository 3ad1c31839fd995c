#include "recon/fusion/volumetric_fusion.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "recon/fusion/volumetric_impl.hpp"

namespace fathom::fusion {
namespace {

constexpr int kEdge = VoxelBlock::kEdge;
// Surfaces seen at a flatter angle (cosine) are left out: their distances along the ray say little.
constexpr double kMinIncidence = 0.05;
// By which boxes are larger than what they hold, for rounding [voxels].
constexpr double kMargin = 1e-3;

static_assert(kEdge == 8);
int blockOf(int voxel) {
  return voxel >> 3;
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

// The places of one block's voxels relative to the camera centre.
struct BlockPlaces {
  float x[kEdge], y[kEdge], z[kEdge];

  BlockPlaces(const BlockKey& key, double voxel, const Eigen::Vector3d& centre) {
    fill(x, key.x, voxel, centre.x());
    fill(y, key.y, voxel, centre.y());
    fill(z, key.z, voxel, centre.z());
  }
  static void fill(float (&to)[kEdge], int block, double voxel, double centre) {
    for (int k = 0; k < kEdge; ++k) to[k] = static_cast<float>((block * kEdge + k) * voxel - centre);
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
    // Computed the same way for both triangles of an edge, so that they agree to the last bit.
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
  impl_->kernels = config.baseline_kernels ? &baselineFusionKernels() : &fastestFusionKernels();
  if (!config.bounds) return;
  // What a mesh outside the overlap could still change lies further off than a part that may be dropped.
  if (!(config.overlap / 2 >= reach() + 2 * config.voxel))
    throw std::invalid_argument("fusion: overlap must be more than twice the reach of a mesh");
  impl_->limits = limitsOf(*config.bounds, config);
}

VolumetricFusion::~VolumetricFusion() = default;

double VolumetricFusion::reach() const {
  // Carving looks at whole blocks.
  return std::max(kMaxBand * impl_->config.truncation, kEdge * impl_->config.voxel);
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
        const BlockKey key{x, y, z};
        const BlockPlaces places(key, config.voxel, centre);
        const BlockVoxels voxels{places.x,
                                 places.y,
                                 places.z,
                                 std::max(first.x() - x * kEdge, 0),
                                 std::min(last.x() - x * kEdge + 1, kEdge),
                                 std::max(first.y() - y * kEdge, 0),
                                 std::min(last.y() - y * kEdge + 1, kEdge)};
        VoxelBlock* block = grid.find(key);
        if (block == nullptr && kernels->fuse(triangle, voxels, nullptr) > 0) block = &grid.make(key);
        if (block != nullptr)
          counters.voxel_updates += static_cast<std::uint64_t>(kernels->fuse(triangle, voxels, block));
      }
    }
  }
  return true;
}

// In the box of the mesh, down from the camera or up to it. Only blocks that hold something are looked at:
// the grid does not grow.
void VolumetricFusion::Impl::carve(const Eigen::Vector3d& centre) {
  Eigen::Array3f low(INFINITY, INFINITY, 0), high(-INFINITY, -INFINITY, 0);
  for (const Eigen::Vector3f& p : range_mesh.points) {
    low = low.min(p.array());
    high = high.max(p.array());
  }
  const double block_size = config.voxel * kEdge;
  const Eigen::Array3i lo = ((low.cast<double>() + centre.array()) / block_size).floor().cast<int>();
  const Eigen::Array3i hi = ((high.cast<double>() + centre.array()) / block_size).floor().cast<int>();
  const float radius = static_cast<float>(0.5 * std::sqrt(3.0) * (kEdge - 1) * config.voxel);
  const auto carveBlock = [&](const BlockKey& key, VoxelBlock& block) {
    const BlockPlaces places(key, config.voxel, centre);
    const Eigen::Vector3f middle(places.x[0] + places.x[kEdge - 1], places.y[0] + places.y[kEdge - 1],
                                 places.z[0] + places.z[kEdge - 1]);
    if (sight.surelyUnknown(middle / 2, radius)) return;
    counters.carved_voxels += static_cast<std::uint64_t>(
        kernels->carve(sight.picture(), {places.x, places.y, places.z, 0, kEdge, 0, kEdge},
                       static_cast<float>(config.truncation), block));
  };
  const auto inBox = [&](const BlockKey& k) {
    const Eigen::Array3i at(k.x, k.y, k.z);
    return (at >= lo).all() && (at <= hi).all();
  };
  // Whichever is less to look at: the blocks there are, or the places in the box.
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

}  // namespace fathom::fusion

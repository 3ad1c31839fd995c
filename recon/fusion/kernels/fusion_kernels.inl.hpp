// The table of one instruction set: the including file defines FATHOM_KERNELS, a namespace's name, and is
// compiled for that set. Vectors are the compiler's own (GCC, Clang); nothing here calls a function of a
// library, which could be taken from the other set.
#include "recon/fusion/kernels/fusion_kernels.hpp"

namespace fathom::fusion::FATHOM_KERNELS {
namespace {

constexpr int kLanes = VoxelBlock::kEdge;
using Floats = float __attribute__((vector_size(4 * kLanes)));
using Ints = std::int32_t __attribute__((vector_size(4 * kLanes)));
using Shorts = std::uint16_t __attribute__((vector_size(2 * kLanes)));

template <typename Vector, typename Element>
inline __attribute__((always_inline)) Vector load(const Element* from) {
  Vector v;
  __builtin_memcpy(&v, from, sizeof v);
  return v;
}
template <typename Vector, typename Element>
inline __attribute__((always_inline)) void store(Element* to, const Vector& v) {
  __builtin_memcpy(to, &v, sizeof v);
}

inline __attribute__((always_inline)) bool any(const Ints& mask) {
  std::int64_t half[kLanes / 2];
  __builtin_memcpy(half, &mask, sizeof half);
  return (half[0] | half[1] | half[2] | half[3]) != 0;
}
inline __attribute__((always_inline)) int countOf(const Ints& mask) {
  int count = 0;
  for (int k = 0; k < kLanes; ++k) count -= mask[k];
  return count;
}

inline __attribute__((always_inline)) Floats squareRoot(const Floats& v) {
  float root[kLanes];
  __builtin_memcpy(root, &v, sizeof root);
  for (float& r : root) r = __builtin_sqrtf(r);
  return load<Floats>(root);
}

// Weighted mean of 16-bit values: old + share * (seen - old), rounded, where the mask is set.
inline __attribute__((always_inline)) void blend(std::uint16_t* values, const Floats& seen,
                                                 const Floats& share, const Ints& mask) {
  const Shorts old = load<Shorts>(values);
  const Floats was = __builtin_convertvector(old, Floats);
  const Ints is = __builtin_convertvector(was + share * (seen - was) + 0.5F, Ints);
  const Shorts chosen = __builtin_convertvector(mask, Shorts);
  store(values, (__builtin_convertvector(is, Shorts) & chosen) | (old & ~chosen));
}

int fuse(const SightTriangle& t, const BlockVoxels& voxels, VoxelBlock* block) {
  const Floats zero = {};
  const Floats z = load<Floats>(voxels.z);
  int updates = 0;
  for (int i = voxels.x0; i < voxels.x1; ++i) {
    for (int j = voxels.y0; j < voxels.y1; ++j) {
      const float x = voxels.x[i], y = voxels.y[j];
      Floats w[3];
      Ints hit = zero == zero;
      for (int k = 0; k < 3; ++k) {
        w[k] = (t.side[k][0] * x + t.side[k][1] * y) + t.side[k][2] * z;
        hit &= (w[k] > zero) | ((w[k] == zero) & t.owns[k]);
      }
      if (!any(hit)) continue;
      const Floats per_sum = 1.0F / ((t.scale[0] * x + t.scale[1] * y) + t.scale[2] * z);
      const Floats range = squareRoot((x * x + y * y) + z * z);
      const Floats distance = (t.plane * per_sum - 1.0F) * range;
      // Behind the surface the weight falls to 0 over the second half of the band, so that the far side of a
      // thin object is left to the meshes that see it.
      Floats behind = 2.0F + distance * (2.0F / t.band);
      behind = behind > 1.0F ? zero + 1.0F : behind;
      const Floats share0 = w[0] * per_sum, share1 = w[1] * per_sum, share2 = w[2] * per_sum;
      const Floats variance = ((share0 * t.variance[0] + share1 * t.variance[1]) + share2 * t.variance[2]) +
                              ((share1 * share2 * t.between[0] + share2 * share0 * t.between[1]) +
                               share0 * share1 * t.between[2]);
      const Floats weight =
          ((share0 * t.weight[0] + share1 * t.weight[1]) + share2 * t.weight[2]) * behind / variance;
      hit &= (distance < t.band) & (distance > -t.band) & (weight > zero);
      if (!any(hit)) continue;
      if (block == nullptr) return 1;

      const std::size_t at = VoxelBlock::local(i, j, 0);
      const Floats old_weight = load<Floats>(&block->weight[at]), old = load<Floats>(&block->distance[at]);
      const Floats total = old_weight + weight;
      const Floats share = weight / total;
      store(&block->distance[at], hit ? old + share * (distance - old) : old);
      store(&block->weight[at], hit ? total : old_weight);
      for (int c = 0; c < 3; ++c) {
        const Floats seen = (share0 * t.colour[0][c] + share1 * t.colour[1][c]) + share2 * t.colour[2][c];
        blend(&block->colour[static_cast<std::size_t>(c)][at], seen, share, hit);
      }
      const Shorts count = load<Shorts>(&block->observations[at]);
      const Shorts room = __builtin_convertvector(hit, Shorts) & (count != 0xFFFF);
      store(&block->observations[at], count - room);  // the mask is -1
      updates += countOf(hit);
    }
  }
  return updates;
}

int carve(const SightPicture& sight, const BlockVoxels& voxels, float free, VoxelBlock& block) {
  const Floats zero = {};
  const Floats z = load<Floats>(voxels.z);
  const auto size = static_cast<float>(SightPicture::kSize);
  int carved = 0;
  for (int i = voxels.x0; i < voxels.x1; ++i) {
    for (int j = voxels.y0; j < voxels.y1; ++j) {
      const std::size_t at = VoxelBlock::local(i, j, 0);
      const Floats old_weight = load<Floats>(&block.weight[at]);
      Ints hit = old_weight > zero;
      if (!any(hit)) continue;
      const float x = voxels.x[i], y = voxels.y[j];
      const auto along = [&](const float* axis) { return (axis[0] * x + axis[1] * y) + axis[2] * z; };
      const Floats depth = along(sight.forward), per_depth = 1.0F / depth;
      const Floats column = (along(sight.right) * per_depth - sight.origin[0]) * sight.scale;
      const Floats row = (along(sight.down) * per_depth - sight.origin[1]) * sight.scale;
      hit &= (depth > zero) & (column >= zero) & (column < size) & (row >= zero) & (row < size);
      const Ints cell = (__builtin_convertvector(hit ? row : zero, Ints) * SightPicture::kSize +
                         __builtin_convertvector(hit ? column : zero, Ints));
      Floats empty_to, weight;
      for (int k = 0; k < kLanes; ++k) empty_to[k] = sight.depth[cell[k]];
      hit &= depth < empty_to;
      if (!any(hit)) continue;
      for (int k = 0; k < kLanes; ++k) weight[k] = sight.weight[cell[k]];
      const Floats old = load<Floats>(&block.distance[at]);
      const Floats total = old_weight + weight;
      store(&block.distance[at], hit ? old + weight / total * (free - old) : old);
      store(&block.weight[at], hit ? total : old_weight);
      carved += countOf(hit);
    }
  }
  return carved;
}

}  // namespace

const FusionKernels& table() {
  static constexpr FusionKernels kTable{fuse, carve};
  return kTable;
}

}  // namespace fathom::fusion::FATHOM_KERNELS

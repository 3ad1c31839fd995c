#pragma once

#include <cstdint>

#include "realtime/base/numbers/instruction_sets.hpp"
#include "recon/fusion/voxel_grid.hpp"

namespace fathom::fusion {

// One triangle of a range mesh for the kernels, relative to the camera centre. The ray through p meets it
// inside when side[k] . p has one sign for all k; these are also the unnormalised weights of the corners at
// that point, and their sum is scale . p.
struct SightTriangle {
  float side[3][3];       // of the edge opposite to the corner
  std::int32_t owns[3];   // all bits or none: whether rays exactly through the edge are this triangle's
  float scale[3], plane;  // the plane is scale . p = plane
  float band;             // [m]
  float weight[3];        // of the corners' observations, but for the variance
  float variance[3];      // of the corners [m^2]
  float between[3];       // added at the middle of the edge opposite to the corner, times four [m^2]
  float colour[3][3];     // of the corners, by channel [1/256 of an 8-bit step]
};

// The voxels of one block: their places relative to the camera centre [m], and the columns to process,
// [x0, x1) and [y0, y1).
struct BlockVoxels {
  const float *x, *y, *z;  // VoxelBlock::kEdge each
  int x0, x1, y0, y1;
};

// Free space in front of the camera, see SightMap.
struct SightPicture {
  static constexpr int kSize = 64;  // cells a side: some two a point of a frame of 800
  float right[3], down[3], forward[3];
  float origin[2], scale;       // cell = (x / z - origin) * scale
  float depth[kSize * kSize];   // along `forward` before which all is empty; -infinity: not known [m]
  float weight[kSize * kSize];  // [1/m^2]
};

// The inner loops, once per instruction set: a column of eight voxels at a time. Single precision in an order
// that does not depend on the vectors' width, without fused multiply-add: every set gives the same bits.
struct FusionKernels {
  // Adds a triangle's observations to the voxels of a block; returns their number. Without a block: whether
  // there are any.
  int (*fuse)(const SightTriangle& triangle, const BlockVoxels& voxels, VoxelBlock* block);

  // Gives voxels in free space an observation of `free` [m]; returns their number.
  int (*carve)(const SightPicture& sight, const BlockVoxels& voxels, float free, VoxelBlock& block);
};

FATHOM_INSTRUCTION_SETS(const FusionKernels&, FusionKernels);

}  // namespace fathom::fusion

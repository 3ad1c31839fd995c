#pragma once

#include <cstddef>
#include <cstdint>

#include "realtime/base/numbers/instruction_sets.hpp"

namespace fathom::stereo {

// Shape of a matching window. Rows are padded with weights of zero to `pitch` samples (a multiple of 16), so
// that vectors of every width process whole rows.
struct PatchShape {
  int window = 0;                               // edge [px]
  int pitch = 0;                                // samples from row to row of a template
  const float* weight = nullptr;                // window x pitch, sum 1
  const std::int16_t* search_weight = nullptr;  // weights scaled so that the largest is kSearchWeight
};

constexpr int kPositionBits = 7;             // positions of samples are multiples of 1/128 px
constexpr int kSampleGain = 32;              // units of a sample per grey level
constexpr int kPaddedPitch = 48;             // samples from row to row of a sampled patch with its margin
constexpr std::int16_t kSearchWeight = 255;  // its product with an 8-bit value minus 128 fits 16 bits

// Weighted sums over a window of a sampled patch: v is the sample minus a given centre, gx and gy are central
// differences [samples per 2 px].
struct PatchMoments {
  float v, gx, gy, vv, vgx, vgy, gxgx, gxgy, gygy;
};

// Three images of a template, rounded to whole numbers: value = scale_v * w * (v - mean) and the
// steepest-descent images, without their component along value: sx = scale_x * w * (gx - mean_x - per_x * (v
// - mean)), sy likewise.
struct TemplateScaling {
  int centre;  // subtracted from samples before anything else
  float mean, mean_x, mean_y, per_x, per_y;
  float scale_v, scale_x, scale_y;
};

// Exact sums over the rounded images, and second moments of sx and sy before rounding.
struct TemplateSums {
  std::int32_t value, sx, sy;                       // sum
  std::int32_t value_sample, sx_sample, sy_sample;  // sum of products with the samples
  float sxsx, sxsy, sysy;
};

struct Correlation {
  std::int32_t cross;  // sum of products of the template's value with the samples
  float mean, square;  // weighted mean of (sample - centre) and of its square
};

// The inner loops, once per instruction set. All arithmetic is in whole numbers, or in single precision in an
// order independent of the vectors' width and without fused multiply-add: every set gives the same bits.
struct Kernels {
  // Vertical binomial filter (1 4 6 4 1) over five rows of `n` columns.
  void (*smoothRows)(const std::uint8_t* const rows[5], int n, std::uint16_t* out);
  // Horizontal binomial filter (1 4 6 4 1)/256 at every second column of `sums`, `n` results. Up to 64 sums
  // beyond the last one needed are read.
  void (*halveRow)(const std::uint16_t* sums, int n, std::uint8_t* out);

  // Sobel gradients of one row, -1020 to 1020.
  void (*gradientRow)(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below, int n,
                      std::int16_t* gx, std::int16_t* gy);
  // Sliding window of the structure tensor: adds the gradients' products of the row that enters and subtracts
  // those of the row that leaves.
  void (*tensorRow)(const std::int16_t* gx_in, const std::int16_t* gy_in, const std::int16_t* gx_out,
                    const std::int16_t* gy_out, int n, std::int32_t* xx, std::int32_t* xy, std::int32_t* yy);
  // Harris measure of sums over five columns, `n` results; 0 unless determinant > floor * trace.
  void (*harrisRow)(const std::int32_t* xx, const std::int32_t* xy, const std::int32_t* yy, int n, float k,
                    float floor, float* out);
  // Columns 0 to n - 1 with a positive value that is the maximum of the 3x3 around, of equal ones the first
  // in raster order. Reads the rows from column -1 to n. Returns their number.
  int (*localMaxima)(const float* above, const float* row, const float* below, int n, std::int32_t* columns);

  // Patches. `origin`: the position of the window's first sample, rounded down; fx, fy: 0 to 127 [1/128 px].
  // Samples of the window and of a margin of one pixel, (window + 2) rows of kPaddedPitch.
  void (*samplePatch)(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride, int fx,
                      int fy, std::int16_t* padded);
  void (*patchMoments)(const PatchShape& shape, const std::int16_t* padded, int centre, PatchMoments& out);
  void (*makeTemplate)(const PatchShape& shape, const std::int16_t* padded, const TemplateScaling& scaling,
                       std::int16_t* value, std::int16_t* sx, std::int16_t* sy, TemplateSums& sums);
  // Sums of products of the window's samples with the three images of the template: value, sx, sy.
  void (*projectPatch)(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride, int fx,
                       int fy, const std::int16_t* value, const std::int16_t* sx, const std::int16_t* sy,
                       std::int32_t sums[3]);
  void (*correlate)(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride, int fx,
                    int fy, int centre, const std::int16_t* value, Correlation& out);
  // At a whole pixel, samples minus 128 in grey levels: the sums of w * v, w * v^2 and value * v.
  void (*searchSums)(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride,
                     const std::int16_t* value, std::int32_t sums[3]);
};

FATHOM_INSTRUCTION_SETS(const Kernels&, Kernels);

}  // namespace fathom::stereo

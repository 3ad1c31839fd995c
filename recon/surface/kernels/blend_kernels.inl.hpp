// The table of one instruction set: the including file defines FATHOM_KERNELS, a namespace's name, and is
// compiled for that set.
#include <cmath>
#include <cstring>

#include "recon/surface/chart_lattice.hpp"
#include "recon/surface/kernels/blend_kernels.hpp"

namespace fathom::surface::FATHOM_KERNELS {
namespace {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));
using Byte4 = std::uint8_t __attribute__((vector_size(4)));
using Short4 = std::uint16_t __attribute__((vector_size(8)));

inline Float4 all(float v) {
  return Float4{v, v, v, v};
}
inline Float4 load(const float* p) {
  Float4 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
inline void store(float* p, Float4 v) {
  std::memcpy(p, &v, sizeof v);
}
inline Float4 least(Float4 a, Float4 b) {
  return a < b ? a : b;
}
inline Float4 most(Float4 a, Float4 b) {
  return a > b ? a : b;
}

template <bool kPorted>
void projectNodesOf(const ViewProjection& view, const NodePoints& nodes, float fade, const NodePixels& out) {
  const auto r = view.rotation;
  const auto t = view.translation;
  // The camera's position relative to the origin.
  const float ex = -(r[0] * t[0] + r[3] * t[1] + r[6] * t[2]);
  const float ey = -(r[1] * t[0] + r[4] * t[1] + r[7] * t[2]);
  const float ez = -(r[2] * t[0] + r[5] * t[1] + r[8] * t[2]);
  const float mu = 0.5F * (view.width - 1), mv = 0.5F * (view.height - 1);
  constexpr float kHalf = 0.5F;  // two axes, each 1 at the border, make 1 in the corner
  const float per_mu = 1.0F / mu, per_mv = 1.0F / mv, per_fade = 1.0F / fade;
  // Faces seen at more than 87 degrees do not count, those under 78 degrees fully.
  constexpr float kEdgeOn = 0.05F, kPerEdge = 1.0F / 0.15F;
  for (int i = 0; i < nodes.count; ++i) {
    const float x = nodes.x[i], y = nodes.y[i], z = nodes.z[i];
    const float px = r[0] * x + r[1] * y + r[2] * z + t[0];
    const float py = r[3] * x + r[4] * y + r[5] * z + t[1];
    const float pz = r[6] * x + r[7] * y + r[8] * z + t[2];
    const bool before = pz > ViewProjection::kNear;
    const float inverse = 1.0F / (before ? pz : 1.0F);
    float a = px * inverse, b = py * inverse, r2 = a * a + b * b;
    bool valid = before & (r2 < view.limit);
    if constexpr (kPorted) valid &= view.throughPort(inverse, a, b, r2);
    const float radial = 1.0F + r2 * (view.k1 + r2 * (view.k2 + r2 * view.k3));
    const float u = view.fx * (a * radial + 2 * view.p1 * a * b + view.p2 * (r2 + 2 * a * a)) + view.cx;
    const float v = view.fy * (b * radial + view.p1 * (r2 + 2 * b * b) + 2 * view.p2 * a * b) + view.cy;
    const float du = u - mu, dv = v - mv;
    const float su = du * per_mu, sv = dv * per_mv;
    const float inside_u = mu - std::fabs(du), inside_v = mv - std::fabs(dv);
    const float inside = (inside_u < inside_v ? inside_u : inside_v) * per_fade;
    const float cx = ex - x, cy = ey - y, cz = ez - z;
    const float facing = (nodes.nx[i] * cx + nodes.ny[i] * cy + nodes.nz[i] * cz) /
                         std::sqrt(cx * cx + cy * cy + cz * cz + 1e-12F);
    const float slope = (facing - kEdgeOn) * kPerEdge;
    float border = inside < 1.0F ? inside : 1.0F;
    border = border > 0.0F ? border : 0.0F;
    float open = slope < 1.0F ? slope : 1.0F;
    open = open > 0.0F ? open : 0.0F;
    const float freedom = border * open;
    out.u[i] = valid ? u : 0.0F;
    out.v[i] = valid ? v : 0.0F;
    out.depth[i] = pz;
    out.centrality[i] = valid ? std::sqrt(kHalf * (su * su + sv * sv)) : 0.0F;
    out.freedom[i] = valid ? freedom : 0.0F;
  }
}

void projectNodes(const ViewProjection& view, const NodePoints& nodes, float fade, const NodePixels& out) {
  if (view.ported)
    projectNodesOf<true>(view, nodes, fade, out);
  else
    projectNodesOf<false>(view, nodes, fade, out);
}

// exp(-x) for x from 0 to 80, to 3e-7 of the value.
inline float decay(float x) {
  constexpr float kLog2E = 1.44269504F, kLn2 = 0.69314718F;
  const float y = x * kLog2E;
  const auto whole = static_cast<std::int32_t>(y);
  const float f = (static_cast<float>(whole) - y) * kLn2;  // -ln 2 to 0
  const float p =
      1 + f * (1 + f * (0.5F + f * (1.0F / 6 + f * (1.0F / 24 + f * (1.0F / 120 + f * (1.0F / 720))))));
  const std::int32_t bits = (127 - whole) << 23;
  float scale;
  std::memcpy(&scale, &bits, sizeof scale);
  return p * scale;
}

void weigh(const float* centrality, const float* freedom, int count, float k, float* out) {
  for (int i = 0; i < count; ++i) {
    const float x = k * centrality[i];
    out[i] = freedom[i] * decay(x < 80.0F ? x : 80.0F);
  }
}

void normalise(float* weights, int views, int count, std::ptrdiff_t row, float* sums) {
  float *largest = sums, *total = sums + count;
  for (int i = 0; i < count; ++i) largest[i] = total[i] = 0;
  for (int view = 0; view < views; ++view) {
    const float* w = weights + view * row;
    for (int i = 0; i < count; ++i) largest[i] = w[i] > largest[i] ? w[i] : largest[i];
  }
  for (int view = 0; view < views; ++view) {
    float* w = weights + view * row;
    for (int i = 0; i < count; ++i) {
      const float left = w[i] - kLeastWeight * largest[i];
      w[i] = left > 0 ? left : 0.0F;
      total[i] += w[i];
    }
  }
  for (int i = 0; i < count; ++i) total[i] = total[i] > 0 ? 1.0F / total[i] : 0.0F;
  for (int view = 0; view < views; ++view) {
    float* w = weights + view * row;
    for (int i = 0; i < count; ++i) w[i] *= total[i];
  }
}

inline Float4 loadShorts(const std::uint16_t* p) {
  Short4 v;
  std::memcpy(&v, p, sizeof v);
  return __builtin_convertvector(__builtin_convertvector(v, Int4), Float4);
}

// The low pass at image position (u, v), between its four values around.
inline Float4 sample(const LowPass& pass, float u, float v) {
  const float centre = 0.5F * static_cast<float>(pass.scale - 1), per = 1.0F / static_cast<float>(pass.scale);
  float x = (u - centre) * per, y = (v - centre) * per;
  const auto last_x = static_cast<float>(pass.width - 1), last_y = static_cast<float>(pass.height - 1);
  x = x > 0 ? (x < last_x ? x : last_x) : 0.0F;
  y = y > 0 ? (y < last_y ? y : last_y) : 0.0F;
  const auto xi = static_cast<int>(x), yi = static_cast<int>(y);
  const std::ptrdiff_t right = xi < pass.width - 1 ? 4 : 0;
  const std::ptrdiff_t below = yi < pass.height - 1 ? static_cast<std::ptrdiff_t>(4) * pass.width : 0;
  const std::uint16_t* p = pass.values.data() + 4 * (static_cast<std::ptrdiff_t>(yi) * pass.width + xi);
  const Float4 a = loadShorts(p), b = loadShorts(p + right);
  const Float4 c = loadShorts(p + below), d = loadShorts(p + below + right);
  const Float4 fx = all(x - static_cast<float>(xi)), fy = all(y - static_cast<float>(yi));
  const Float4 top = a + fx * (b - a), bottom = c + fx * (d - c);
  return (top + fy * (bottom - top)) * all(1.0F / LowPass::kUnit);
}

void gatherBands(const LowPass& fine, const LowPass& coarse, const float* u, const float* v, const float* low,
                 const float* middle, const float* high, int count, float* colour, float* fine_of_high) {
  for (int i = 0; i < count; ++i) {
    if (!(low[i] > 0) && !(middle[i] > 0) && !(high[i] > 0)) continue;
    const Float4 g1 = sample(fine, u[i], v[i]);
    Float4 sum = load(colour + 4 * i) + all(middle[i]) * g1;
    if (low[i] != middle[i]) sum += all(low[i] - middle[i]) * sample(coarse, u[i], v[i]);
    store(colour + 4 * i, sum);
    store(fine_of_high + 4 * i, load(fine_of_high + 4 * i) + all(high[i]) * g1);
  }
}

inline Float4 loadPixel(const std::uint8_t* p) {
  Byte4 v;
  std::memcpy(&v, p, sizeof v);
  return __builtin_convertvector(__builtin_convertvector(v, Int4), Float4);
}

inline Float4 samplePixels(const std::uint8_t* p, std::ptrdiff_t stride, float fx, float fy) {
  const Float4 a = loadPixel(p), b = loadPixel(p + 3);
  const Float4 c = loadPixel(p + stride), d = loadPixel(p + stride + 3);
  const Float4 x = all(fx), y = all(fy);
  const Float4 top = a + x * (b - a), bottom = c + x * (d - c);
  return top + y * (bottom - top);
}

constexpr int kStep = ChartLattice::kStep;
constexpr int kHalves = kStep / 4;     // vectors of a row of a cell
constexpr float kPart = 1.0F / kStep;  // from texel to texel of a cell

// Values of a part of a row of a cell from those in its corners.
inline Float4 rowOf(const std::array<float, 4>& corner, float down, int half) {
  const float left = corner[0] + down * (corner[2] - corner[0]);
  const float right = corner[1] + down * (corner[3] - corner[1]);
  const auto first = static_cast<float>(4 * half);
  const Float4 across = (Float4{0, 1, 2, 3} + all(first)) * all(kPart);
  return all(left) + across * all(right - left);
}

inline void storeTexel(std::uint8_t* out, Float4 value) {
  const Float4 cut = most(least(value + all(0.5F), all(255.0F)), all(0.0F));
  const Int4 whole = __builtin_convertvector(cut, Int4);
  out[0] = static_cast<std::uint8_t>(whole[0]);
  out[1] = static_cast<std::uint8_t>(whole[1]);
  out[2] = static_cast<std::uint8_t>(whole[2]);
}

struct RowPixels {
  Float4 fx, fy;
  Int4 xi, yi;
};

inline RowPixels pixelsOf(const CellView& view, float down, int half) {
  const Float4 u = most(least(rowOf(view.u, down, half), all(view.limit_u)), all(0.0F));
  const Float4 v = most(least(rowOf(view.v, down, half), all(view.limit_v)), all(0.0F));
  const Int4 xi = __builtin_convertvector(u, Int4), yi = __builtin_convertvector(v, Int4);
  return {u - __builtin_convertvector(xi, Float4), v - __builtin_convertvector(yi, Float4), xi, yi};
}

inline const std::uint8_t* addressOf(const CellView& view, std::int32_t x, std::int32_t y) {
  return view.pixels + y * view.stride + static_cast<std::ptrdiff_t>(3) * x;
}

void blendCell(const CellView* views, int count, const float* base, const CellTexels& texels) {
  Float4 sum[kStep * kStep];
  const Float4 b0 = load(base), b1 = load(base + 4), b2 = load(base + 8), b3 = load(base + 12);
  for (int y = 0; y < kStep; ++y) {
    const Float4 down = all(kPart * static_cast<float>(y));
    const Float4 left = b0 + down * (b2 - b0), step = (b1 + down * (b3 - b1) - left) * all(kPart);
    Float4 value = left;
    for (int x = 0; x < kStep; ++x, value += step) sum[kStep * y + x] = value;
  }
  for (int i = 0; i < count; ++i) {
    const CellView& view = views[i];
    for (int y = 0; y < texels.rows; ++y) {
      const float down = kPart * static_cast<float>(y);
      for (int half = 0; half < kHalves; ++half) {
        const RowPixels at = pixelsOf(view, down, half);
        const Float4 weight = rowOf(view.weight, down, half);
        Float4* to = sum + kStep * y + 4 * half;
        for (int x = 0; x < 4; ++x)
          to[x] += all(weight[x]) *
                   samplePixels(addressOf(view, at.xi[x], at.yi[x]), view.stride, at.fx[x], at.fy[x]);
      }
    }
  }
  for (int y = 0; y < texels.rows; ++y)
    for (int x = 0; x < texels.columns; ++x)
      storeTexel(texels.out + y * texels.stride + static_cast<std::ptrdiff_t>(3) * x, sum[kStep * y + x]);
}

void bestCell(const CellView* views, int count, const CellTexels& texels, std::uint32_t* chosen) {
  for (int y = 0; y < texels.rows; ++y) {
    const float down = kPart * static_cast<float>(y);
    for (int x = 0; x < texels.columns; ++x) {
      const int half = x / 4, lane = x % 4;
      const CellView* best = views;
      float largest = 0;
      for (int i = 0; i < count; ++i) {
        const float weight = rowOf(views[i].weight, down, half)[lane];
        if (weight > largest) largest = weight, best = views + i;
      }
      chosen[kStep * y + x] = static_cast<std::uint32_t>(best - views);
      const RowPixels at = pixelsOf(*best, down, half);
      storeTexel(
          texels.out + y * texels.stride + static_cast<std::ptrdiff_t>(3) * x,
          samplePixels(addressOf(*best, at.xi[lane], at.yi[lane]), best->stride, at.fx[lane], at.fy[lane]));
    }
  }
}

}  // namespace

const BlendKernels& table() {
  static constexpr BlendKernels kTable{projectNodes, weigh, normalise, gatherBands, blendCell, bestCell};
  return kTable;
}

}  // namespace fathom::surface::FATHOM_KERNELS

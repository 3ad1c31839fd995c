// The table of one instruction set: the including file defines FATHOM_KERNELS, a namespace's name, and is
// compiled for that set.
#ifdef __AVX2__
// OpenCV's header takes the set from these names when it is not built as a part of OpenCV.
#include <immintrin.h>
#define CV_CPU_DISPATCH_MODE AVX2
#define CV_SSE3 1
#define CV_SSSE3 1
#define CV_SSE4_1 1
#define CV_SSE4_2 1
#define CV_POPCNT 1
#define CV_AVX 1
#define CV_AVX2 1
#endif
#include <opencv2/core/hal/intrin.hpp>

#include "recon/stereo/kernels/kernels.hpp"

namespace fathom::stereo::FATHOM_KERNELS {
namespace {

// Whatever of cv this brings in exists once per set, in a namespace of its own.
using namespace cv;  // NOLINT

// Loops over image rows: pyramid and corners. The last vector of a row may begin before the one before it
// ended.

void smoothRows(const std::uint8_t* const rows[5], int n, std::uint16_t* out) {
  const int lanes = v_uint16::nlanes;
  for (int x = 0; x < n; x += lanes) {
    const v_uint16 a = vx_load_expand(rows[0] + x), b = vx_load_expand(rows[1] + x);
    const v_uint16 c = vx_load_expand(rows[2] + x), d = vx_load_expand(rows[3] + x);
    const v_uint16 e = vx_load_expand(rows[4] + x);
    const v_uint16 near = v_add_wrap(v_add_wrap(b, d), c);
    const v_uint16 sum = v_add_wrap(v_add_wrap(a, e), v_add_wrap(v_shl<2>(near), v_shl<1>(c)));
    v_store(out + x, sum);
  }
}

void halveRow(const std::uint16_t* sums, int n, std::uint8_t* out) {
  const int lanes = v_uint16::nlanes;
  const v_uint16 half = vx_setall_u16(128);
  for (int x = 0; x < n; x += lanes) {
    const std::uint16_t* s = sums + 2 * x;
    v_uint16 e0, o0, e1, o1, e2, o2;
    v_load_deinterleave(s - 2, e0, o0);
    v_load_deinterleave(s, e1, o1);
    v_load_deinterleave(s + 2, e2, o2);
    // Sums are at most 16 * 255: the total stays below 2^16.
    const v_uint16 near = v_add_wrap(v_add_wrap(o0, o1), e1);
    const v_uint16 total =
        v_add_wrap(v_add_wrap(v_add_wrap(e0, e2), half), v_add_wrap(v_shl<2>(near), v_shl<1>(e1)));
    v_pack_store(out + x, v_shr<8>(total));
  }
}

void gradientRow(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below, int n,
                 std::int16_t* gx, std::int16_t* gy) {
  const int lanes = v_int16::nlanes;
  const auto load = [](const std::uint8_t* p) { return v_reinterpret_as_s16(vx_load_expand(p)); };
  for (int x = 0; x < n; x += lanes) {
    const v_int16 a0 = load(above + x - 1), a1 = load(above + x), a2 = load(above + x + 1);
    const v_int16 b0 = load(row + x - 1), b2 = load(row + x + 1);
    const v_int16 c0 = load(below + x - 1), c1 = load(below + x), c2 = load(below + x + 1);
    const v_int16 corner0 = v_sub_wrap(c2, a0), corner1 = v_sub_wrap(a2, c0);
    v_store(gx + x, v_add_wrap(v_add_wrap(corner0, corner1), v_shl<1>(v_sub_wrap(b2, b0))));
    v_store(gy + x, v_add_wrap(v_sub_wrap(corner0, corner1), v_shl<1>(v_sub_wrap(c1, a1))));
  }
}

void tensorRow(const std::int16_t* gx_in, const std::int16_t* gy_in, const std::int16_t* gx_out,
               const std::int16_t* gy_out, int n, std::int32_t* xx, std::int32_t* xy, std::int32_t* yy) {
  const int lanes = v_int16::nlanes, half = v_int32::nlanes;
  const v_int16 zero = vx_setzero_s16();
  const auto add = [](std::int32_t* to, const v_int32& v) { v_store(to, vx_load(to) + v); };
  for (int x = 0; x < n; x += lanes) {
    const v_int16 xi = vx_load(gx_in + x), yi = vx_load(gy_in + x);
    const v_int16 xo = vx_load(gx_out + x), yo = vx_load(gy_out + x);
    v_int16 x0, x1, y0, y1, dx0, dx1, dy0, dy1;
    v_zip(xi, xo, x0, x1);
    v_zip(yi, yo, y0, y1);
    v_zip(xi, v_sub_wrap(zero, xo), dx0, dx1);
    v_zip(yi, v_sub_wrap(zero, yo), dy0, dy1);
    add(xx + x, v_dotprod(x0, dx0));
    add(xx + x + half, v_dotprod(x1, dx1));
    add(xy + x, v_dotprod(y0, dx0));
    add(xy + x + half, v_dotprod(y1, dx1));
    add(yy + x, v_dotprod(y0, dy0));
    add(yy + x + half, v_dotprod(y1, dy1));
  }
}

void harrisRow(const std::int32_t* xx, const std::int32_t* xy, const std::int32_t* yy, int n, float k,
               float floor, float* out) {
  const int lanes = v_float32::nlanes;
  const v_float32 vk = vx_setall_f32(k), vfloor = vx_setall_f32(floor), zero = vx_setzero_f32();
  const auto five = [](const std::int32_t* p) {
    return v_cvt_f32(vx_load(p) + vx_load(p + 1) + vx_load(p + 2) + vx_load(p + 3) + vx_load(p + 4));
  };
  for (int x = 0; x < n; x += lanes) {
    const v_float32 a = five(xx + x), b = five(xy + x), c = five(yy + x);
    const v_float32 trace = a + c, determinant = a * c - b * b;
    const v_float32 response = v_max(determinant - vk * trace * trace, zero);
    v_store(out + x, response & (determinant > vfloor * trace));
  }
}

int localMaxima(const float* above, const float* row, const float* below, int n, std::int32_t* columns) {
  const int lanes = v_float32::nlanes;
  int count = 0;
  for (int x = 0; x < n; x += lanes) {
    const v_float32 r = vx_load(row + x);
    const v_float32 before = v_max(v_max(vx_load(above + x - 1), vx_load(above + x)),
                                   v_max(vx_load(above + x + 1), vx_load(row + x - 1)));
    const v_float32 after = v_max(v_max(vx_load(below + x - 1), vx_load(below + x)),
                                  v_max(vx_load(below + x + 1), vx_load(row + x + 1)));
    const v_float32 is = (r > v_max(before, vx_setzero_f32())) & (r >= after);
    int mask = v_signmask(is);
    for (int i = 0; mask != 0; ++i, mask >>= 1)
      if ((mask & 1) != 0 && x + i < n) columns[count++] = x + i;
  }
  return count;
}

// Loops over matching windows.

// Eight lanes of single precision, in one vector or two: sums over a window have the same order in every
// instruction set.
struct Float8 {
  static constexpr int kParts = 8 / v_float32::nlanes;
  v_float32 part[kParts];
};

inline Float8 zero8() {
  Float8 r;
  for (v_float32& p : r.part) p = vx_setzero_f32();
  return r;
}
inline Float8 all8(float value) {
  Float8 r;
  for (v_float32& p : r.part) p = vx_setall_f32(value);
  return r;
}
inline Float8 load8(const float* from) {
  Float8 r;
  for (int k = 0; k < Float8::kParts; ++k) r.part[k] = vx_load(from + k * v_float32::nlanes);
  return r;
}
// Difference of whole numbers.
inline Float8 difference8(const std::int16_t* a, const std::int16_t* b) {
  Float8 r;
  for (int k = 0; k < Float8::kParts; ++k)
    r.part[k] =
        v_cvt_f32(vx_load_expand(a + k * v_float32::nlanes) - vx_load_expand(b + k * v_float32::nlanes));
  return r;
}
inline Float8 load8(const std::int16_t* from) {
  Float8 r;
  for (int k = 0; k < Float8::kParts; ++k)
    r.part[k] = v_cvt_f32(vx_load_expand(from + k * v_float32::nlanes));
  return r;
}
inline Float8 operator+(const Float8& a, const Float8& b) {
  Float8 r;
  for (int k = 0; k < Float8::kParts; ++k) r.part[k] = a.part[k] + b.part[k];
  return r;
}
inline Float8 operator-(const Float8& a, const Float8& b) {
  Float8 r;
  for (int k = 0; k < Float8::kParts; ++k) r.part[k] = a.part[k] - b.part[k];
  return r;
}
inline Float8 operator*(const Float8& a, const Float8& b) {
  Float8 r;
  for (int k = 0; k < Float8::kParts; ++k) r.part[k] = a.part[k] * b.part[k];
  return r;
}
inline void storeRounded(std::int16_t* to, const Float8& v) {
  for (int k = 0; k < Float8::kParts; ++k) v_pack_store(to + k * v_float32::nlanes, v_round(v.part[k]));
}
inline float sum(const Float8& v) {
  alignas(32) float f[8];
  for (int k = 0; k < Float8::kParts; ++k) v_store(f + k * v_float32::nlanes, v.part[k]);
  return ((f[0] + f[4]) + (f[1] + f[5])) + ((f[2] + f[6]) + (f[3] + f[7]));
}

// Bilinear interpolation in whole numbers. Between two columns the value has kPositionBits fractional bits
// and fits 15; between two rows the low bits beyond the five of kSampleGain are dropped, an offset of half a
// step that matching does not see.
inline v_int16 across(const std::uint8_t* p, const v_int16& fx) {
  const v_int16 a = v_reinterpret_as_s16(vx_load_expand(p)), b = v_reinterpret_as_s16(vx_load_expand(p + 1));
  return v_add_wrap(v_shl<kPositionBits>(a), v_mul_wrap(v_sub_wrap(b, a), fx));
}
inline v_int16 down(const v_int16& upper, const v_int16& lower, const v_int16& fy) {
  return v_add_wrap(v_shr<2>(upper), v_mul_hi(v_sub_wrap(lower, upper), fy));
}
inline v_int16 rowFraction(int fy) {
  return vx_setall_s16(static_cast<short>(fy << 7));  // v_mul_hi takes 16 bits off: 7 + 7 + 2
}

void samplePatch(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride, int fx, int fy,
                 std::int16_t* padded) {
  const v_int16 vfx = vx_setall_s16(static_cast<short>(fx)), vfy = rowFraction(fy);
  const int edge = shape.window + 2;
  for (int c = 0; c < edge; c += v_int16::nlanes) {
    const std::uint8_t* p = origin - stride - 1 + c;
    std::int16_t* out = padded + c;
    v_int16 upper = across(p, vfx);
    for (int j = 0; j < edge; ++j, out += kPaddedPitch) {
      p += stride;
      const v_int16 lower = across(p, vfx);
      v_store(out, down(upper, lower, vfy));
      upper = lower;
    }
  }
}

void patchMoments(const PatchShape& shape, const std::int16_t* padded, int centre, PatchMoments& out) {
  const Float8 vcentre = all8(static_cast<float>(centre));
  Float8 sv = zero8(), sx = sv, sy = sv, svv = sv, svx = sv, svy = sv, sxx = sv, sxy = sv, syy = sv;
  const float* weight = shape.weight;
  for (int j = 0; j < shape.window; ++j) {
    const std::int16_t* t = padded + (j + 1) * kPaddedPitch + 1;
    for (int c = 0; c < shape.pitch; c += 8, weight += 8) {
      const Float8 w = load8(weight);
      const Float8 v = load8(t + c) - vcentre;
      const Float8 gx = difference8(t + c + 1, t + c - 1);
      const Float8 gy = difference8(t + c + kPaddedPitch, t + c - kPaddedPitch);
      const Float8 wv = w * v, wx = w * gx, wy = w * gy;
      sv = sv + wv;
      sx = sx + wx;
      sy = sy + wy;
      svv = svv + wv * v;
      svx = svx + wv * gx;
      svy = svy + wv * gy;
      sxx = sxx + wx * gx;
      sxy = sxy + wx * gy;
      syy = syy + wy * gy;
    }
  }
  out = {sum(sv), sum(sx), sum(sy), sum(svv), sum(svx), sum(svy), sum(sxx), sum(sxy), sum(syy)};
}

void makeTemplate(const PatchShape& shape, const std::int16_t* padded, const TemplateScaling& scaling,
                  std::int16_t* value, std::int16_t* sx, std::int16_t* sy, TemplateSums& sums) {
  const Float8 centre = all8(static_cast<float>(scaling.centre) + scaling.mean);
  const Float8 mean_x = all8(scaling.mean_x), mean_y = all8(scaling.mean_y);
  const Float8 per_x = all8(scaling.per_x), per_y = all8(scaling.per_y);
  const Float8 scale_v = all8(scaling.scale_v), scale_x = all8(scaling.scale_x),
               scale_y = all8(scaling.scale_y);
  Float8 sxsx = zero8(), sxsy = sxsx, sysy = sxsx;
  const float* weight = shape.weight;
  for (int j = 0; j < shape.window; ++j) {
    const std::int16_t* t = padded + (j + 1) * kPaddedPitch + 1;
    for (int c = 0; c < shape.pitch; c += 8, weight += 8) {
      const int k = j * shape.pitch + c;
      const Float8 w = load8(weight);
      const Float8 v = load8(t + c) - centre;
      const Float8 gx = difference8(t + c + 1, t + c - 1);
      const Float8 gy = difference8(t + c + kPaddedPitch, t + c - kPaddedPitch);
      const Float8 x = w * (gx - mean_x - per_x * v), y = w * (gy - mean_y - per_y * v);
      sxsx = sxsx + x * x;
      sxsy = sxsy + x * y;
      sysy = sysy + y * y;
      storeRounded(value + k, scale_v * (w * v));
      storeRounded(sx + k, scale_x * x);
      storeRounded(sy + k, scale_y * y);
    }
  }
  v_int32 n[6];
  for (v_int32& s : n) s = vx_setzero_s32();
  const v_int16 one = vx_setall_s16(1);
  for (int j = 0; j < shape.window; ++j) {
    const std::int16_t* t = padded + (j + 1) * kPaddedPitch + 1;
    for (int c = 0; c < shape.pitch; c += v_int16::nlanes) {
      const int k = j * shape.pitch + c;
      const v_int16 v = vx_load(value + k), x = vx_load(sx + k), y = vx_load(sy + k), s = vx_load(t + c);
      n[0] += v_dotprod(v, one);
      n[1] += v_dotprod(x, one);
      n[2] += v_dotprod(y, one);
      n[3] += v_dotprod(v, s);
      n[4] += v_dotprod(x, s);
      n[5] += v_dotprod(y, s);
    }
  }
  sums = {v_reduce_sum(n[0]), v_reduce_sum(n[1]), v_reduce_sum(n[2]), v_reduce_sum(n[3]), v_reduce_sum(n[4]),
          v_reduce_sum(n[5]), sum(sxsx),          sum(sxsy),          sum(sysy)};
}

void projectPatch(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride, int fx, int fy,
                  const std::int16_t* value, const std::int16_t* sx, const std::int16_t* sy,
                  std::int32_t sums[3]) {
  const v_int16 vfx = vx_setall_s16(static_cast<short>(fx)), vfy = rowFraction(fy);
  v_int32 nv = vx_setzero_s32(), nx = nv, ny = nv;
  for (int c = 0; c < shape.pitch; c += v_int16::nlanes) {
    const std::uint8_t* p = origin + c;
    v_int16 upper = across(p, vfx);
    for (int j = 0; j < shape.window; ++j) {
      p += stride;
      const v_int16 lower = across(p, vfx);
      const v_int16 s = down(upper, lower, vfy);
      const int k = j * shape.pitch + c;
      nv += v_dotprod(s, vx_load(value + k));
      nx += v_dotprod(s, vx_load(sx + k));
      ny += v_dotprod(s, vx_load(sy + k));
      upper = lower;
    }
  }
  sums[0] = v_reduce_sum(nv);
  sums[1] = v_reduce_sum(nx);
  sums[2] = v_reduce_sum(ny);
}

void correlate(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride, int fx, int fy,
               int centre, const std::int16_t* value, Correlation& out) {
  const v_int16 vfx = vx_setall_s16(static_cast<short>(fx)), vfy = rowFraction(fy);
  const Float8 vcentre = all8(static_cast<float>(centre));
  alignas(64) std::int16_t row[32];
  v_int32 common = vx_setzero_s32();
  Float8 mean = zero8(), square = mean;
  for (int j = 0; j < shape.window; ++j) {
    const std::uint8_t* p = origin + j * stride;
    for (int c = 0; c < shape.pitch; c += v_int16::nlanes) {
      const v_int16 s = down(across(p + c, vfx), across(p + c + stride, vfx), vfy);
      common += v_dotprod(s, vx_load(value + j * shape.pitch + c));
      v_store(row + c, s);
    }
    for (int c = 0; c < shape.pitch; c += 8) {
      const Float8 s = load8(row + c) - vcentre, ws = load8(shape.weight + j * shape.pitch + c) * s;
      mean = mean + ws;
      square = square + ws * s;
    }
  }
  out = {v_reduce_sum(common), sum(mean), sum(square)};
}

void searchSums(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride,
                const std::int16_t* value, std::int32_t sums[3]) {
  const v_int16 middle = vx_setall_s16(128);
  v_int32 mean = vx_setzero_s32(), square = mean, common = mean;
  for (int j = 0; j < shape.window; ++j) {
    const std::uint8_t* p = origin + j * stride;
    for (int c = 0; c < shape.pitch; c += v_int16::nlanes) {
      const int k = j * shape.pitch + c;
      const v_int16 s = v_sub_wrap(v_reinterpret_as_s16(vx_load_expand(p + c)), middle);
      const v_int16 w = vx_load(shape.search_weight + k);
      mean += v_dotprod(s, w);
      square += v_dotprod(v_mul_wrap(s, w), s);
      common += v_dotprod(s, vx_load(value + k));
    }
  }
  sums[0] = v_reduce_sum(mean);
  sums[1] = v_reduce_sum(square);
  sums[2] = v_reduce_sum(common);
}

}  // namespace

const Kernels& table() {
  static constexpr Kernels kTable{smoothRows,   halveRow,     gradientRow, tensorRow,
                                  harrisRow,    localMaxima,  samplePatch, patchMoments,
                                  makeTemplate, projectPatch, correlate,   searchSums};
  return kTable;
}

}  // namespace fathom::stereo::FATHOM_KERNELS

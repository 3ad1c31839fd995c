// Inner loops over matching windows. Included once per instruction set by kernels.inl.hpp, inside
// its namespace.

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

void likeness(const PatchShape& shape, const std::uint8_t* origin, std::ptrdiff_t stride, int fx, int fy,
              int centre, const std::int16_t* value, Likeness& out) {
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

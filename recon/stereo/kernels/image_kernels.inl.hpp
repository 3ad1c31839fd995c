// Inner loops over image rows: pyramid and corners. Included once per instruction set by kernels.inl.hpp,
// inside its namespace. The last vector of a row may begin before the one before it ended.

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

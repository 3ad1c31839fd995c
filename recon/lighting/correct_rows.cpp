#include "recon/lighting/correct_rows.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>

namespace fathom::lighting {
namespace {

constexpr int kStep = 8;  // pixels at a time

// Gain and offset as functions of the column x: value + x * slope.
struct Ramp {
  float gain, gain_slope, offset, offset_slope;
};

Ramp rampBetween(const Correction* nodes, int i, int count, int width) {
  const Correction a = nodes[i], b = nodes[std::min(i + 1, count - 1)];
  const float per_pixel = static_cast<float>(count) / static_cast<float>(width);
  const float x = (static_cast<float>(i) + 0.5F) / per_pixel - 0.5F;  // of node i
  const float gain_slope = (b.gain - a.gain) * per_pixel, offset_slope = (b.offset - a.offset) * per_pixel;
  return {a.gain - x * gain_slope, gain_slope, a.offset - x * offset_slope, offset_slope};
}

// Where the stretch after node i ends; a whole step, so that only the row's end is left over. Half a step
// beyond its end a ramp is as good as the next one.
int endOfStretch(int i, int count, int width) {
  if (i >= count - 2) return width;
  const double x = (i + 1.5) * width / count;
  return std::min(static_cast<int>(std::lround(x / kStep)) * kStep, width);
}

std::uint8_t correctOne(float sample, const Ramp& r, float x) {
  const float v = sample * (r.gain + x * r.gain_slope) + r.offset + x * r.offset_slope;
  return static_cast<std::uint8_t>(std::lrint(std::clamp(v, 0.0F, 255.0F)));
}

cv::v_uint16x8 load(const std::uint8_t* in) {
  return cv::v_load_expand(in);
}
cv::v_uint16x8 load(const std::uint16_t* in) {
  return cv::v_load(in);
}

}  // namespace

template <typename T>
void correctRow(const T* in, int width, const Correction* even, const Correction* odd, int nodes,
                std::uint8_t* out) {
  int x = 0;
  for (int i = 0; x < width; ++i) {
    const Ramp e = rampBetween(even, std::min(i, nodes - 1), nodes, width);
    const Ramp o = rampBetween(odd, std::min(i, nodes - 1), nodes, width);
    const int end = endOfStretch(i, nodes, width);
    const auto lanes = [&](float Ramp::*value, float Ramp::*slope, float from) {
      return cv::v_float32x4(e.*value + from * e.*slope, o.*value + (from + 1) * o.*slope,
                             e.*value + (from + 2) * e.*slope, o.*value + (from + 3) * o.*slope);
    };
    const auto xf = static_cast<float>(x);
    cv::v_float32x4 gain0 = lanes(&Ramp::gain, &Ramp::gain_slope, xf);
    cv::v_float32x4 gain1 = lanes(&Ramp::gain, &Ramp::gain_slope, xf + 4);
    cv::v_float32x4 offset0 = lanes(&Ramp::offset, &Ramp::offset_slope, xf);
    cv::v_float32x4 offset1 = lanes(&Ramp::offset, &Ramp::offset_slope, xf + 4);
    const cv::v_float32x4 gain_step(kStep * e.gain_slope, kStep * o.gain_slope, kStep * e.gain_slope,
                                    kStep * o.gain_slope);
    const cv::v_float32x4 offset_step(kStep * e.offset_slope, kStep * o.offset_slope, kStep * e.offset_slope,
                                      kStep * o.offset_slope);
    for (; x + kStep <= end; x += kStep) {
      cv::v_uint32x4 low, high;
      cv::v_expand(load(in + x), low, high);
      const cv::v_float32x4 v0 = cv::v_cvt_f32(cv::v_reinterpret_as_s32(low));
      const cv::v_float32x4 v1 = cv::v_cvt_f32(cv::v_reinterpret_as_s32(high));
      const cv::v_int32x4 r0 = cv::v_round(cv::v_muladd(v0, gain0, offset0));
      const cv::v_int32x4 r1 = cv::v_round(cv::v_muladd(v1, gain1, offset1));
      cv::v_pack_u_store(out + x, cv::v_pack(r0, r1));
      gain0 += gain_step;
      gain1 += gain_step;
      offset0 += offset_step;
      offset1 += offset_step;
    }
    for (; x < end; ++x)
      out[x] = correctOne(static_cast<float>(in[x]), x % 2 == 0 ? e : o, static_cast<float>(x));
  }
}

template <typename T>
void correctRgbRow(const T* in, int width, const Correction* const (&channels)[3], int nodes,
                   std::uint8_t* out) {
  int x = 0;
  for (int i = 0; x < width; ++i) {
    const int node = std::min(i, nodes - 1), end = endOfStretch(i, nodes, width);
    const Ramp ramps[3] = {rampBetween(channels[0], node, nodes, width),
                           rampBetween(channels[1], node, nodes, width),
                           rampBetween(channels[2], node, nodes, width)};
    for (; x < end; ++x)
      for (int c = 0; c < 3; ++c)
        out[3 * x + c] = correctOne(static_cast<float>(in[3 * x + c]), ramps[c], static_cast<float>(x));
  }
}

template void correctRow(const std::uint8_t*, int, const Correction*, const Correction*, int, std::uint8_t*);
template void correctRow(const std::uint16_t*, int, const Correction*, const Correction*, int, std::uint8_t*);
template void correctRgbRow(const std::uint8_t*, int, const Correction* const (&)[3], int, std::uint8_t*);
template void correctRgbRow(const std::uint16_t*, int, const Correction* const (&)[3], int, std::uint8_t*);

}  // namespace fathom::lighting

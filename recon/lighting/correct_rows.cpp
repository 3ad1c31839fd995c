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

Ramp rampAfter(const RowPlan& plan, const Correction* nodes, std::size_t i) {
  const Correction a = nodes[i], b = nodes[std::min(i + 1, static_cast<std::size_t>(plan.nodes) - 1)];
  const float gain_slope = (b.gain - a.gain) * plan.per_pixel;
  const float offset_slope = (b.offset - a.offset) * plan.per_pixel;
  return {a.gain - plan.x[i] * gain_slope, gain_slope, a.offset - plan.x[i] * offset_slope, offset_slope};
}

// sRGB of linear light by its square root, and the square roots of that.
constexpr float kRoot = 0.662002687F, kRoot2 = 0.684122060F, kRoot3 = -0.323583601F, kPlain = -0.0225411470F;
constexpr float kLevels = 255.0F;

template <Encoding kEncoding>
std::uint8_t correctOne(float sample, const Ramp& r, float x) {
  float v = sample * (r.gain + x * r.gain_slope) + r.offset + x * r.offset_slope;
  if constexpr (kEncoding == Encoding::kSrgb) {
    const float light = std::clamp(v, 0.0F, 1.0F);
    const float s1 = std::sqrt(light), s2 = std::sqrt(s1), s3 = std::sqrt(s2);
    v = kLevels * (kRoot * s1 + kRoot2 * s2 + kRoot3 * s3 + kPlain * light);
  }
  return static_cast<std::uint8_t>(std::lrint(std::clamp(v, 0.0F, kLevels)));
}

template <Encoding kEncoding>
cv::v_float32x4 encoded(const cv::v_float32x4& v) {
  if constexpr (kEncoding == Encoding::kLevels) return v;
  const auto all = [](float value) { return cv::v_setall_f32(value); };
  const cv::v_float32x4 light = cv::v_min(cv::v_max(v, all(0)), all(1));
  const cv::v_float32x4 s1 = cv::v_sqrt(light), s2 = cv::v_sqrt(s1), s3 = cv::v_sqrt(s2);
  return all(kLevels) * (all(kRoot) * s1 + all(kRoot2) * s2 + all(kRoot3) * s3 + all(kPlain) * light);
}

cv::v_uint16x8 load(const std::uint8_t* in) {
  return cv::v_load_expand(in);
}
cv::v_uint16x8 load(const std::uint16_t* in) {
  return cv::v_load(in);
}

}  // namespace

// A stretch is a whole number of steps, so that only the row's end is left over: half a step beyond its end a
// ramp is as good as the next one.
RowPlan::RowPlan(int row_width, int node_count)
    : width(row_width),
      nodes(node_count),
      per_pixel(static_cast<float>(node_count) / static_cast<float>(row_width)) {
  for (int i = 0; i < nodes; ++i) {
    const double next = (i + 1.5) * width / nodes;
    x[static_cast<std::size_t>(i)] = static_cast<float>((i + 0.5) * width / nodes - 0.5);
    end[static_cast<std::size_t>(i)] =
        i >= nodes - 2 ? width : std::min(static_cast<int>(std::lround(next / kStep)) * kStep, width);
  }
}

template <Encoding kEncoding, typename T>
void correctRow(const RowPlan& plan, const T* in, const Correction* even, const Correction* odd,
                std::uint8_t* out) {
  int x = 0;
  for (std::size_t i = 0; x < plan.width; ++i) {
    const Ramp e = rampAfter(plan, even, i), o = rampAfter(plan, odd, i);
    const int end = plan.end[i];
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
      const cv::v_int32x4 r0 = cv::v_round(encoded<kEncoding>(cv::v_muladd(v0, gain0, offset0)));
      const cv::v_int32x4 r1 = cv::v_round(encoded<kEncoding>(cv::v_muladd(v1, gain1, offset1)));
      cv::v_pack_u_store(out + x, cv::v_pack(r0, r1));
      gain0 += gain_step;
      gain1 += gain_step;
      offset0 += offset_step;
      offset1 += offset_step;
    }
    for (; x < end; ++x)
      out[x] = correctOne<kEncoding>(static_cast<float>(in[x]), x % 2 == 0 ? e : o, static_cast<float>(x));
  }
}

template <Encoding kEncoding, typename T>
void correctRgbRow(const RowPlan& plan, const T* in, const Correction* const (&channels)[3],
                   std::uint8_t* out) {
  int x = 0;
  for (std::size_t i = 0; x < plan.width; ++i) {
    const Ramp ramps[3] = {rampAfter(plan, channels[0], i), rampAfter(plan, channels[1], i),
                           rampAfter(plan, channels[2], i)};
    for (; x < plan.end[i]; ++x)
      for (int c = 0; c < 3; ++c)
        out[3 * x + c] =
            correctOne<kEncoding>(static_cast<float>(in[3 * x + c]), ramps[c], static_cast<float>(x));
  }
}

#define FATHOM_ROWS(encoding, T)                                                                     \
  template void correctRow<encoding>(const RowPlan&, const T*, const Correction*, const Correction*, \
                                     std::uint8_t*);                                                 \
  template void correctRgbRow<encoding>(const RowPlan&, const T*, const Correction* const(&)[3],     \
                                        std::uint8_t*);
FATHOM_ROWS(Encoding::kLevels, std::uint8_t)
FATHOM_ROWS(Encoding::kLevels, std::uint16_t)
FATHOM_ROWS(Encoding::kSrgb, std::uint8_t)
FATHOM_ROWS(Encoding::kSrgb, std::uint16_t)
#undef FATHOM_ROWS

}  // namespace fathom::lighting

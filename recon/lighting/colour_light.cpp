#include "recon/lighting/colour_light.hpp"

#include <Eigen/Cholesky>
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

// Least spread over mean of the mean channel's linear light: hazy dives and mud have less and are lifted to
// it. All channels are lifted alike, so that hues stay.
constexpr float kLeastContrast = 0.2F, kGamma = 2.2F;
constexpr float kLeastLight = 0.3F;  // from the ground, of all: with less, gain would show noise alone
constexpr float kLeast = 0.002F;     // of full scale: half a level of 8 bits

// IEC 61966-2-1, of a level well above black.
float linearOf(float srgb) {
  return std::pow((srgb + 0.055F) / 1.055F, 2.4F);
}

constexpr float kPedestalsPerOctave = 2;  // classes of expected brightness

constexpr float kGross = 3.0F;  // times the expected light, or a part of it: a fish, a glint, no tilt

// Coefficients of the three unknowns; the response is 1 plus their products.
Eigen::Vector3f factors(const RangeLattice::Ground& ground) {
  const float depth = ground.point.z();
  return {-ground.normal.dot(ground.point) / depth - 1, ground.normal.x() / depth, ground.normal.y() / depth};
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
      const cv::v_int32x4 r0 = cv::v_round(encoded<kEncoding>(v0 * gain0 + offset0));
      const cv::v_int32x4 r1 = cv::v_round(encoded<kEncoding>(v1 * gain1 + offset1));
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

void TiltResponse::add(const RangeLattice::Ground& ground, float ratio) {
  if (!(ratio > 1 / kGross && ratio < kGross) || !(ground.point.z() > 0)) return;
  const Eigen::Vector3d f = factors(ground).cast<double>();
  normal_ += f * f.transpose();
  right_ += f * (static_cast<double>(ratio) - 1);
}

void TiltResponse::solve() {
  constexpr double kPatch = 0.3;     // spread of what patches return beside tilt
  constexpr double kAlike = 50;      // patches that share their ground with others
  constexpr double kStrength = 0.3;  // prior, about 1
  constexpr double kAside = 0.5;     // prior, about the camera [m]
  const double weight = 1 / (kPatch * kPatch * kAlike);
  const Eigen::Vector3d prior(1 / (kStrength * kStrength), 1 / (kAside * kAside), 1 / (kAside * kAside));
  Eigen::Matrix3d a = weight * normal_;
  a.diagonal() += prior;
  const Eigen::Vector3d b = weight * right_ + prior.x() * Eigen::Vector3d::UnitX();
  const Eigen::Vector3d x = a.ldlt().solve(b);
  if (!x.allFinite()) return;
  solution_ = {static_cast<float>(std::clamp(x.x(), 0.0, 1.5)), static_cast<float>(x.y()),
               static_cast<float>(x.z())};
}

void TiltResponse::halve() {
  normal_ /= 2;
  right_ /= 2;
}

float TiltResponse::at(const RangeLattice::Ground& ground) const {
  if (!(ground.point.z() > 0)) return 1;
  return std::clamp(1 + solution_.dot(factors(ground)), kDarkest, kBrightest);
}

void Pedestal::add(float expected, float ratio) {
  if (!(expected > 0) || !(ratio < kGross)) return;
  const float at = std::round(-kPedestalsPerOctave * std::log2(expected));
  const auto k = static_cast<std::size_t>(std::clamp(at, 0.0F, static_cast<float>(kClasses - 1)));
  count_[k] += 1, expected_[k] += expected, sum_[k] += ratio, squares_[k] += ratio * ratio;
}

void Pedestal::solve() {
  constexpr double kFewest = 200;  // nodes of a class
  constexpr double kAlike = 50;    // nodes that share their ground with others
  constexpr double kOther = 0.15;  // relative: other ground has other contrast
  constexpr double kUsual = 0.02;  // prior, about 0: parts of full scale
  double w = 0, wx = 0, wy = 0, wxx = 0, wxy = 0, least = 1;
  for (std::size_t k = 0; k < count_.size(); ++k) {
    const double n = count_[k];
    if (n < kFewest) continue;
    const double mean = sum_[k] / n, variance = squares_[k] / n - mean * mean;
    if (!(variance > 0)) continue;
    const double contrast = std::sqrt(variance), m = expected_[k] / n;
    const double weight = 1 / (variance * (kAlike / (2 * n) + kOther * kOther));
    w += weight, wx += weight / m, wy += weight * contrast;
    wxx += weight / (m * m), wxy += weight * contrast / m;
    least = std::min(least, m);
  }
  level_ = 0;
  if (w == 0) return;
  // contrast = c0 - (c0 b) / m; the prior holds c0 b by the contrast that is usual here.
  const double usual = wy / w * kUsual;
  const double slope = (wxy - wx * wy / w) / (wxx - wx * wx / w + 1 / (usual * usual));
  const double at_full = (wy - slope * wx) / w;
  constexpr double kMost = 0.8;  // of the darkest class
  if (at_full > 0) level_ = static_cast<float>(std::clamp(-slope / at_full, 0.0, kMost * least));
}

void Pedestal::halve() {
  for (std::size_t k = 0; k < count_.size(); ++k)
    count_[k] /= 2, expected_[k] /= 2, sum_[k] /= 2, squares_[k] /= 2;
}

ColourLight::ColourLight(std::size_t channels, bool encoded, int bits, double grey)
    : encoded_(encoded),
      full_(static_cast<float>((1 << bits) - 1)),
      light_(encoded ? static_cast<float>(grey) : linearOf(static_cast<float>(grey))),
      pedestals_(channels) {}

void ColourLight::learn(std::size_t channel, float expected, float ratio,
                        const RangeLattice::Ground* ground) {
  pedestals_[channel].add(expected, ratio);
  if (ground != nullptr) tilt_.add(*ground, tilt_.at(*ground) * ratio);
}

void ColourLight::solve(float contrast) {
  const float least = encoded_ ? kLeastContrast / kGamma : kLeastContrast;
  lift_ = std::max(1.0F, least / std::max(contrast, kLeast));
  tilt_.solve();
  for (Pedestal& p : pedestals_) p.solve();
}

void ColourLight::halve() {
  tilt_.halve();
  for (Pedestal& p : pedestals_) p.halve();
}

float ColourLight::samplesFor(double light) const {
  return static_cast<float>(encoded_ ? std::pow(light, 1 / kGamma) : light);
}

Correction ColourLight::correction(std::size_t channel, const ChannelModel& model, const Level& level,
                                   float brightness, float slope, float fall) const {
  const float mean = model.lit(std::exp(level.log_mean), brightness * slope);
  const float dark = model.lit(std::max(pedestal(channel), model.black()), brightness);
  const float returned = std::max({mean - dark, kLeastLight * (mean - model.black()), kLeast});
  const float to = encoded_ ? 255.0F : 1.0F, gain = light_ * lift_ / (returned * fall);
  return {to * gain / full_, to * (light_ * (1 - lift_) - gain * (mean - returned))};
}

}  // namespace fathom::lighting

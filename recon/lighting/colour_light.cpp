#include "recon/lighting/colour_light.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::lighting {
namespace {

// Of the mean channel's linear light, spread over mean: a dive with less is seen through haze all the way, or
// is mud that nobody could tell apart. All channels are lifted alike, so that no hue turns.
constexpr float kLeastContrast = 0.2F, kGamma = 2.2F;
constexpr float kLeastLight = 0.3F;  // from the ground, of all: with less, gain would show noise alone
constexpr float kLeast = 0.002F;     // of full scale: half a level of 8 bits

// IEC 61966-2-1, of a level well above black.
float linearOf(float srgb) {
  return std::pow((srgb + 0.055F) / 1.055F, 2.4F);
}

}  // namespace

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

Correction ColourLight::correction(std::size_t channel, const Level& level, float brightness) const {
  const float mean = brightness * std::exp(level.log_mean);
  const float returned = std::max({mean - pedestal(channel), kLeastLight * mean, kLeast});
  const float to = encoded_ ? 255.0F : 1.0F, gain = light_ * lift_ / returned;
  return {to * gain / full_, to * (light_ - gain * mean)};
}

}  // namespace fathom::lighting

#include "sim/sea/light/surface_detail.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/hash64.hpp"

namespace fathom::sim {
namespace {

struct DetailOctave {
  float step_m;                  // of the noise lattice; features are about two steps long
  float sand, rock;              // share of the contrast
  float sand_slope, rock_slope;  // standard deviation of the relief's slope, about
  float tint;                    // towards red, away from blue
};

constexpr DetailOctave kDetailOctaves[] = {
    {0.0015F, 0.75F, 0.55F, 0.05F, 0.08F, 0.00F}, {0.0034F, 0.60F, 0.70F, 0.06F, 0.12F, 0.02F},
    {0.0073F, 0.40F, 0.75F, 0.06F, 0.14F, 0.03F}, {0.0157F, 0.28F, 0.80F, 0.04F, 0.14F, 0.05F},
    {0.0331F, 0.20F, 0.60F, 0.03F, 0.10F, 0.04F},
};
constexpr std::size_t kGritOctave = 1;  // shell grit: the few highest peaks of this octave are bright
constexpr float kLowestGain = 0.15F;

}  // namespace

SurfaceDetail::SurfaceDetail(std::uint64_t seed, double contrast)
    : volume_(seed),
      lattice_from_local_(
          Eigen::AngleAxisf(0.7F, Eigen::Vector3f(0.6F, -0.4F, 0.69F).normalized()).toRotationMatrix()),
      contrast_(static_cast<float>(contrast)) {}

SurfaceDetail::SurfaceDetail(std::uint64_t seed, std::shared_ptr<const AlbedoImages> images)
    : SurfaceDetail(seed, 0.0) {
  images_ = std::move(images);
}

SurfaceDetail SurfaceDetail::of(const TerrainConfig& terrain) {
  constexpr std::uint64_t kStream = 500;  // apart from what else the terrain's seed draws
  const std::uint64_t seed = hash64(terrain.seed, kStream);
  if (terrain.albedo_images.empty()) return {seed, terrain.detail_contrast};
  return {seed, std::make_shared<const AlbedoImages>(terrain.albedo_images, terrain.albedo_pixel_m,
                                                     terrain.albedo_contrast, seed)};
}

void SurfaceDetail::apply(const Eigen::Vector3f& position, float footprint_m, SurfacePoint& point) const {
  if (images_) point.albedo = images_->at(position, point.normal, footprint_m);
  if (contrast_ <= 0) return;
  const Eigen::Vector3f place = lattice_from_local_ * position;
  float sum = 0, tint = 0, grit = 0;
  Eigen::Vector3f slope(0, 0, 0);
  for (std::size_t i = 0; i < std::size(kDetailOctaves); ++i) {
    const DetailOctave& o = kDetailOctaves[i];
    // Two steps are a wave; from 1.4 to 3 pixels a wave it fades in.
    float share = smoothstep(0.7F, 1.5F, o.step_m / footprint_m);
    share *= 1.0F - smoothstep(0.4F, 0.8F, o.step_m / point.resolved_m);
    if (share <= 0) continue;
    Eigen::Vector3f gradient;
    const Eigen::Vector3f offset(11.3F * static_cast<float>(i), 7.7F * static_cast<float>(i), 0);
    const float value = volume_.sample(place / o.step_m + offset, gradient);
    const float hard = point.hardness;
    sum += share * (o.sand + hard * (o.rock - o.sand)) * value;
    slope += (share * (o.sand_slope + hard * (o.rock_slope - o.sand_slope))) * gradient;
    tint += share * o.tint * value;
    if (i == kGritOctave) grit = share * (1 - hard) * smoothstep(2.2F, 3.0F, value);
  }
  const float strength = contrast_ / 0.22F;  // the shares above are for the default contrast
  const float gain = std::max(kLowestGain, 1.0F + contrast_ * sum + 1.2F * strength * grit);
  point.albedo[0] *= gain * (1.0F + strength * tint);
  point.albedo[1] *= gain;
  point.albedo[2] *= gain * (1.0F - strength * tint);
  const Eigen::Vector3f tilt = lattice_from_local_.transpose() * slope;
  point.normal = (point.normal - strength * (tilt - point.normal * point.normal.dot(tilt))).normalized();
}

}  // namespace fathom::sim

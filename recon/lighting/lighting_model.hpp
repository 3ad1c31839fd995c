#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/lighting/lighting_config.hpp"
#include "recon/lighting/node_statistics.hpp"
#include "recon/lighting/range_lattice.hpp"

namespace fathom::lighting {

// Model that corrects images. kNone: nothing learnt yet.
enum class LightingKind : std::uint8_t { kNone, kWholeImage, kPlain, kRangeDependent };

// "none", "whole image", "plain" or "range-dependent".
[[nodiscard]] const char* nameOf(LightingKind kind);

// How a colour's light falls off with range r [m]: in proportion to r^power exp(-per_metre r).
struct Attenuation {
  double power = 0, per_metre = 0;
  [[nodiscard]] double logAt(double range) const { return power * std::log(range) - per_metre * range; }

  static void exchange(auto& archive, auto& self) { archive(self.power, self.per_metre); }
};
struct WaterLaw {
  std::array<Attenuation, 3> colours;  // red, green, blue
  double share = 0;                    // of the difference to what was learnt that is beyond doubt; 0: none

  static void exchange(auto& archive, auto& self) { archive(self.colours, self.share); }
};

// By how much a law of water differs from what a model learnt, which takes ground that is darker at some
// ranges for light that falls there: natural logarithm of the light by that law over the model's, by colour
// and class of range, 0 in the mean over what was seen. Over level ground at the usual depth the pattern over
// the image holds the fall from its middle to its edges already, whatever the law.
struct FallCorrection {
  std::array<std::array<float, RangeBins::kKnown>, 3> log_light{};
  float usual = 0;  // depth [m]; 0: no correction

  // Of ground at a slant range and a depth along the camera's axis [m]; not positive: unknown, 0.
  [[nodiscard]] float at(std::size_t colour, float range, float depth) const {
    if (!(usual > 0) || !(range > 0) || !(depth > 0)) return 0;
    const auto& light = log_light[colour];
    return RangeBins::between(light, range) - RangeBins::between(light, usual * range / depth) +
           RangeBins::between(light, usual);
  }

  static void exchange(auto& archive, auto& self) { archive(self.log_light, self.usual); }
};

// What is known of the light of one image.
struct ImageLight {
  double exposure_s = 0;     // as stamped; 0: unknown
  double gain = 1;           // its brightness over that which its exposure predicts
  FallCorrection fall = {};  // of its colours
};

// Per-pixel, per-channel mean m and standard deviation s of many images, turned into gain and offset that
// bring each pixel to a target mean and deviation:
//   out = target_mean + target_sigma (in - m) / s
// Removes the strobes' pattern, vignetting and the water's colour (grey world), alike over the whole mission:
// no image is normalised by itself, but for grey() of one whose texture is too faint. Works on the mosaic of
// a Bayer image. After Johnson-Roberson et al. 2010, section 4.1.
//
// m and s come from one of three models:
//   whole image      one for all pixels
//   plain            by pixel
//   range-dependent  by pixel and range r, log m = a(pixel) + T(r) + q(pixel, r): see ChannelModel. T follows
//                    r^p exp(-c r) by channel (as Bryson et al. 2016, "True color correction of autonomous
//                    underwater vehicle imagery", fit attenuation to stereo range), plus the images'
//                    departure from it; s removes the veil of backscattered light with m.
// All three predict each image before it is learnt. The model with the least mean absolute error of the
// smoothed brightness (in logarithms, over about the last 100 images) corrects; another replaces it when
// it is 5 % better. Before `min_images` images the whole-image model corrects, at first after them the
// plain one.
//
// Fish, shadows and glints: see NodeStatistics. All memory is allocated by the constructor; add() and
// correct() allocate nothing.
class LightingModel {
 public:
  // The shape of all images. Throws std::invalid_argument for a shape or configuration that cannot be.
  LightingModel(int width, int height, PixelFormat format, int bits, const LightingConfig& config);
  ~LightingModel();

  // Learns an image, without the parts that its mask hides. The models are solved after every image up to the
  // 32nd, then each time that the number of images has grown by 1/16. Images of another shape are ignored and
  // counted. Without ranges, or where they are unknown, an image counts for the first two models alone. After
  // config.memory further images what was learnt counts half. `exposure_s`: the image's stamped exposure, to
  // which its light is in proportion (what the sensor reads in the dark is not); 0: unknown, taken to be that
  // of the first image with a stamp.
  void add(const ImageView& image, const RangeLattice& range, double exposure_s = 0);
  void add(const ImageView& image);
  [[nodiscard]] int images() const;
  // Images of another shape, or taken while the strobes stayed dark.
  [[nodiscard]] std::uint64_t ignoredImages() const;
  // Whether the strobes stayed dark: most of the image is below a seventh of what is expected of lit ground
  // at those ranges. False of a wrong shape, and before anything is known.
  [[nodiscard]] bool unlit(const ImageView& image, const RangeLattice& range, double exposure_s = 0) const;

  // Corrects into 8 bits of the same mosaic, mono or RGB; `out` has width * height (RGB: times 3) bytes, row
  // after row. Before the first image full scale becomes 255; a wrongly shaped image becomes black. Without
  // ranges, or where they are unknown, the plain model stands in for the range-dependent one. Several threads
  // may correct at once while none adds.
  void correct(const ImageView& image, const RangeLattice& range, std::uint8_t* out,
               double exposure_s = 0) const;
  void correct(const ImageView& image, std::uint8_t* out) const;

  // The same in sRGB, for maps and the eye: each channel's linear light over the dive's mean of it, so that
  // hues stay; the haze of a dive without contrast is lifted (see ColourLight). RGB of 8 bits is taken to be
  // sRGB already, everything else to be linear light.
  void correctColour(const ImageView& image, const RangeLattice& range, std::uint8_t* out,
                     const ImageLight& light = {}) const;

  // correctColour() into `mosaic`, then demosaicRgb() into `rgb` (3 * width * height bytes). Where a sample
  // is clipped the hue is not known: the pixel is grey, as light as its lightest channel.
  void colours(const ImageView& image, const RangeLattice& range, std::uint8_t* mosaic, std::uint8_t* rgb,
               const ImageLight& light = {}) const;

  // correct() into `mosaic`, then greyOf() into `grey` (width * height bytes); both once more with more gain
  // and without the veil where the ground's texture is too faint for 8 bits (textureGain()), but before the
  // first image, which may be of a board. A colour of a mosaic has for share the contrast of the ground in it
  // as it comes: corrected, red that the water took is as strong as the others again, but noisier, and a mono
  // camera beside this one hardly sees it. `rgb` as for colours(); a mono image needs neither.
  void grey(const ImageView& image, const RangeLattice& range, std::uint8_t* mosaic, std::uint8_t* rgb,
            std::uint8_t* grey, double exposure_s = 0) const;

  // Natural logarithm of the light that the model which corrects expects from a range [m], less a constant; 0
  // of a model that knows no range.
  [[nodiscard]] double logFall(std::size_t colour, double range) const;
  // From what it learnt, in each colour, to that law.
  [[nodiscard]] FallCorrection correctionTo(const WaterLaw& water) const;
  // Images that show a class of range, and the geometric mean of these [m]; 0: none.
  [[nodiscard]] double seen(int bin) const;
  [[nodiscard]] double usualRange() const;

  // Which model correct() uses.
  [[nodiscard]] LightingKind used() const;

  struct Report {
    LightingKind used = LightingKind::kNone;
    int images = 0;
    double outlier_share = 0;  // of samples that were left out: fish, shadows, glints
    double saturated_share = 0;
    // Mean absolute error of each model's predictions, in natural logarithms; negative: never tried.
    double error_whole = -1, error_plain = -1, error_range = -1;
    double black = 0;            // greatest channel's reading without light from the ground, of full scale
    double tilt = 0;             // how strongly slopes darken; 1: Lambert's law
    Eigen::Vector2f lamp{0, 0};  // where the lamps are effectively, across the camera's axis [m]
    std::array<Attenuation, 3> attenuation;  // red, green, blue; a mono image: all alike; 0 without ranges
    std::size_t memory_bytes = 0;
  };
  [[nodiscard]] Report report() const;

  // Saves and restores all that was learnt, bit by bit, for a model of the same shape and configuration. A
  // model must not be used after its load() failed.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Selects images of new ground to learn from: a vehicle that hovers would imprint its scene on the light's
// pattern. An image is taken when its camera is farther than a fifth of its footprint from the last 64 that
// were taken. Fixed memory.
class NewGround {
 public:
  // `camera`: position in a frame without jumps [m]; `footprint`: its shorter side [m].
  [[nodiscard]] bool take(const Eigen::Vector3d& camera, double footprint) noexcept {
    for (std::size_t i = 0; i < taken_.size(); ++i)
      if ((taken_[i] - camera).norm() < kNewShare * footprint) return false;
    taken_.pushDroppingOldest(camera);
    return true;
  }

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) { archive(self.taken_); }

 private:
  static constexpr double kNewShare = 0.2;
  static constexpr std::size_t kPlaces = 64;
  rt::FixedQueue<Eigen::Vector3d, kPlaces> taken_;
};

}  // namespace fathom::lighting

#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::lighting {

struct LightingConfig {
  double target_mean = 0.42;      // of full scale, after correction
  double target_sigma = 0.13;     // of full scale
  int min_images = 8;             // before that, one mean and variance for the whole image and channel
  int grid = 8;                   // statistics are kept at one of grid x grid pixels of a channel and interpolated
  double saturated = 0.98;        // of full scale: such samples do not enter the statistics
};

// Per-pixel, per-channel mean and variance of many images (Welford), turned into gain and offset that map each
// pixel to a target mean and variance: removes the strobes' pattern and vignetting and balances colour (grey world),
// alike over the whole mission. Works on the mosaic of a Bayer image. After Johnson-Roberson et al. 2010, section 4.1.
class LightingModel {
 public:
  LightingModel(int width, int height, PixelFormat format, int bits, const LightingConfig& config);
  ~LightingModel();

  void add(const ImageView& image);         // learns; wrongly shaped images are ignored and counted
  [[nodiscard]] int images() const;
  [[nodiscard]] std::uint64_t ignoredImages() const;

  // Corrects into 8 bits of the same mosaic or mono; `out` has width * height bytes, row after row.
  void correct(const ImageView& image, std::uint8_t* out) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Bilinear demosaic of an 8-bit RGGB mosaic (as correct() gives) to RGB, and to luminance; `out` is width * height
// * 3, or width * height bytes. A mono image is copied.
void demosaicRgb(const ImageView& mosaic, std::uint8_t* out);
void demosaicMono(const ImageView& mosaic, std::uint8_t* out);

}  // namespace fathom::lighting

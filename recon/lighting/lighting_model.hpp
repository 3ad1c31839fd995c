#pragma once

#include <cstdint>
#include <memory>

#include "recon/geometry/image_view.hpp"

namespace fathom::lighting {

struct LightingConfig {
  double target_mean = 0.42;   // of full scale, after correction
  double target_sigma = 0.13;  // of full scale
  int min_images = 8;          // before that, one mean and variance for the whole image and channel
  int grid = 8;             // statistics are kept at one of grid x grid pixels of a channel and interpolated
  double saturated = 0.98;  // of full scale: such samples do not enter the statistics
};

// Per-pixel, per-channel mean and variance of many images (Welford), turned into gain and offset that map
// each pixel to a target mean and variance: removes the strobes' pattern and vignetting and balances colour
// (grey world), alike over the whole mission. Works on the mosaic of a Bayer image. After Johnson-Roberson et
// al. 2010, section 4.1.
//
// The pattern is smooth and the seafloor is not, so while images are few the statistics of neighbouring nodes
// are pooled, over as many as it takes to average the seafloor out; after some thousand each node stands
// alone.
class LightingModel {
 public:
  // The shape of all images. Throws std::invalid_argument for a shape or configuration that cannot be.
  LightingModel(int width, int height, PixelFormat format, int bits, const LightingConfig& config);
  ~LightingModel();

  // Learns. Gain and offset follow at every image up to the 64th, from then on when 1/32 more have been
  // seen. Wrongly shaped images are ignored and counted.
  void add(const ImageView& image);
  [[nodiscard]] int images() const;
  [[nodiscard]] std::uint64_t ignoredImages() const;

  // Corrects into 8 bits of the same mosaic, mono or RGB; `out` has width * height (RGB: times 3) bytes, row
  // after row. Before the first image full scale becomes 255; a wrongly shaped image becomes black. Several
  // threads may correct at once while none adds.
  void correct(const ImageView& image, std::uint8_t* out) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Bilinear demosaic of an 8-bit RGGB mosaic (as correct() gives) to RGB, and to luminance (0.299 R + 0.587 G
// + 0.114 B); `out` is width * height * 3, or width * height bytes. A mono image is copied (to RGB: three
// times), an RGB image is copied (to mono: its luminance). An image that is empty or not of 8 bits leaves
// `out` as it is.
void demosaicRgb(const ImageView& mosaic, std::uint8_t* out);
void demosaicMono(const ImageView& mosaic, std::uint8_t* out);

}  // namespace fathom::lighting

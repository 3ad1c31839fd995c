#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/stereo/kernels/kernels.hpp"

namespace fathom::stereo {

[[nodiscard]] inline std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

// One 8-bit grey image with a border of repeated edge pixels, so that windows near the edge need no
// special case.
class GrayLevel {
 public:
  // [px]; room for a window of up to 31 px, with its gradients, about any pixel of the image.
  static constexpr int kBorder = 20;

  void resize(int width, int height);
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] int stride() const { return stride_; }
  // Pixel (0, y) of the image; columns from -kBorder to width + kBorder - 1 may be read, rows likewise.
  [[nodiscard]] const std::uint8_t* row(int y) const { return pixels_.data() + offset(y); }
  [[nodiscard]] std::uint8_t* row(int y) { return pixels_.data() + offset(y); }
  // Repeats the edge pixels into the border.
  void extendBorder();

 private:
  [[nodiscard]] std::size_t offset(int y) const {
    return static_cast<std::size_t>(y + kBorder) * static_cast<std::size_t>(stride_) + kBorder;
  }

  int width_ = 0, height_ = 0, stride_ = 0;
  std::vector<std::uint8_t> pixels_;
};

// Grey images at 1, 1/2, 1/4... of the size, each smoothed by the binomial kernel (1 4 6 4 1)/16 (Burt &
// Adelson 1983) before every second pixel is taken: position p of level 0 is position p / 2^l of level l.
class GrayPyramid {
 public:
  static constexpr int kMinSide = 16;  // least side of a level [px]

  // Number of levels, at most `wanted`, of an image of this size.
  [[nodiscard]] static int levels(int width, int height, int wanted);
  // Reserves the memory of images of this size; `levels`: at least 1; small images get fewer.
  GrayPyramid(int width, int height, int levels, const Kernels& kernels);

  // `image`: 8-bit mono of the size above.
  void build(const ImageView& image);
  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
  [[nodiscard]] const GrayLevel& level(int l) const { return levels_[static_cast<std::size_t>(l)]; }

 private:
  void halve(const GrayLevel& fine, GrayLevel& coarse);

  const Kernels* kernels_;
  std::vector<GrayLevel> levels_;
  std::vector<std::uint16_t> rows_;  // vertical sums of one coarse row
};

}  // namespace fathom::stereo

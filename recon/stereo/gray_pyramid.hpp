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

struct Corner {
  int x = 0, y = 0;    // pixel
  float response = 0;  // Harris measure, relative within one image
};

// Part of an image: columns from x0 to x1 - 1, rows from y0 to y1 - 1.
struct PixelBox {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

// Harris corners (Harris & Stephens 1988: det M - 0.04 (trace M)^2, M summed over 5x5 pixels of Sobel
// gradients), spread over the image: the box is cut into about one cell for every two wanted corners, the
// local maxima of each cell are ranked, and cells give their next best corner in turn, so that every part of
// the image gets corners.
class HarrisCorners {
 public:
  // Reserves the memory for images of up to `width` and as many as `max_corners` corners.
  HarrisCorners(int width, int max_corners, const Kernels& kernels);

  // At most `max_corners` (and no more than reserved) local maxima inside `box`, at least `margin` pixels
  // from the image's edge, ordered by rank within the cell. No two are closer than a third of the mean
  // spacing. The result is reused by the next call.
  const std::vector<Corner>& find(const GrayLevel& image, const PixelBox& box, int margin, int max_corners);

 private:
  struct Cells {
    int columns = 0, rows = 0;
    double width = 1, height = 1;  // [px]
  };
  void scan(const GrayLevel& image, const PixelBox& box, const Cells& cells);
  void rank(int cell, const Corner& corner);
  void select(const Cells& cells, const PixelBox& box, int max_corners);
  [[nodiscard]] bool clearOfChosen(const Corner& corner, const PixelBox& box, const Cells& cells,
                                   double distance) const;

  const Kernels* kernels_;
  int width_, max_corners_;
  std::vector<std::int16_t> gradients_;    // ring of rows: x, y
  std::vector<std::int32_t> sums_;         // of gradient products over the ring's rows: xx, xy, yy
  std::vector<float> responses_;           // ring of three rows
  std::vector<std::int32_t> maxima_;       // columns of one row
  std::vector<std::int32_t> cell_column_;  // per column of the box
  std::vector<Corner> ranked_;             // kRanks a cell, best first
  std::vector<std::uint8_t> counts_;       // ranked corners in a cell
  std::vector<std::uint16_t> chosen_;      // bit r: the cell's corner of rank r is chosen
  std::vector<std::uint32_t> turn_;        // cells that may give a corner of the present rank
  std::vector<Corner> corners_;
};

}  // namespace fathom::stereo

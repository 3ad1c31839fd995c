#pragma once

#include <cstdint>
#include <vector>

#include "recon/stereo/gray_pyramid.hpp"
#include "recon/stereo/kernels/kernels.hpp"

namespace fathom::stereo {

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

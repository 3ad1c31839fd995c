#pragma once

#include <cstdint>
#include <vector>

#include "recon/stereo/gray_pyramid.hpp"

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
// local maxima of each cell are ranked, and the cells take turns, so that a bright, textured part cannot
// starve the rest.
class HarrisCorners {
 public:
  // At most `max_corners` local maxima inside `box` and `margin` pixels away from the image's edge, ordered
  // by rank within the cell. No two lie closer than a third of the mean spacing. The result is reused by the
  // next call.
  const std::vector<Corner>& find(const GrayLevel& image, const PixelBox& box, int margin, int max_corners);

 private:
  struct Cells {
    int columns = 0, rows = 0;
    double width = 1, height = 1;  // [px]
  };
  void scan(const GrayLevel& image, const PixelBox& box, const Cells& cells);
  void select(const Cells& cells, const PixelBox& box, int max_corners);
  [[nodiscard]] bool clearOfChosen(const Corner& corner, const PixelBox& box, const Cells& cells,
                                   double distance) const;

  std::vector<std::int32_t> products_;  // ring of rows of gradient products
  std::vector<std::int32_t> sums_;
  std::vector<float> responses_;       // ring of three rows
  std::vector<Corner> ranked_;         // kRanks a cell, best first
  std::vector<std::uint8_t> counts_;   // ranked corners in a cell
  std::vector<std::uint16_t> chosen_;  // bit r: the cell's corner of rank r is chosen
  std::vector<std::uint32_t> turn_;    // cells that may give a corner of the present rank
  std::vector<Corner> corners_;
};

}  // namespace fathom::stereo

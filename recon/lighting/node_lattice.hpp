#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::lighting {

[[nodiscard]] inline std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

// The samples of one channel within an image: all of a mono image, one of four of a Bayer mosaic, one of
// three of RGB.
struct Channel {
  int column = 0, row = 0;  // first sample; columns count samples, not pixels
  int column_step = 1, row_step = 1;
  int width = 0, height = 0;  // samples of the channel in a row, and rows
};

[[nodiscard]] inline std::vector<Channel> channelsOf(int width, int height, PixelFormat format) {
  switch (format) {
    case PixelFormat::kMono:
      return {{0, 0, 1, 1, width, height}};
    case PixelFormat::kRgb:
      return {{0, 0, 3, 1, width, height}, {1, 0, 3, 1, width, height}, {2, 0, 3, 1, width, height}};
    case PixelFormat::kBayerRggb:
      break;
  }
  std::vector<Channel> channels;
  for (int row = 0; row < 2; ++row)
    for (int column = 0; column < 2; ++column)
      channels.push_back({column, row, 2, 2, (width + 1 - column) / 2, (height + 1 - row) / 2});
  return channels;
}

// Nodes in the middles of equal cells that tile the image, the same for all its channels.
struct NodeLattice {
  static constexpr int kMaxSide = 128;  // nodes in a row or column: the pattern is far smoother

  int columns = 1, rows = 1;
  int width = 0, height = 0;  // of the image [px]

  NodeLattice() = default;
  // Cells about `grid` pixels wide.
  NodeLattice(int image_width, int image_height, int grid)
      : columns(cells(image_width, grid)),
        rows(cells(image_height, grid)),
        width(image_width),
        height(image_height) {}

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
  // Middle of a column or row of nodes, in parts of the image's side.
  [[nodiscard]] float u(int column) const {
    return (static_cast<float>(column) + 0.5F) / static_cast<float>(columns);
  }
  [[nodiscard]] float v(int row) const { return (static_cast<float>(row) + 0.5F) / static_cast<float>(rows); }

 private:
  static int cells(int side, int cell) { return std::clamp((side + cell / 2) / cell, 1, kMaxSide); }
};

}  // namespace fathom::lighting

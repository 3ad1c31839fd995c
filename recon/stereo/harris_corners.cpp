#include "recon/stereo/harris_corners.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace fathom::stereo {
namespace {

constexpr int kBlock = 5;                  // edge of the window over which M is summed [px]
constexpr int kHalf = kBlock / 2;          // [px]
constexpr float kHarrisK = 0.04F;          // Harris & Stephens
constexpr int kRanks = 12;                 // corners remembered in a cell
constexpr double kCornersPerCell = 2.0;    // wanted, at the mean
constexpr double kMinSpacing = 1.0 / 3.0;  // between corners, of the mean spacing
constexpr float kSobelGain = 8.0F;         // the Sobel kernel answers 8 to a slope of 1 grey level a pixel
// The weaker gradient of a corner, root mean square over the window [grey levels a pixel]: below it,
// quantisation and read noise look the same as texture.
constexpr float kMinGradient = 0.4F;

std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

// Products of the Sobel gradients of one row: xx, xy, yy, each `n` long, for pixels x0 .. x0 + n - 1.
void gradientProducts(const GrayLevel& image, int y, int x0, int n, std::int32_t* xx, std::int32_t* xy,
                      std::int32_t* yy) {
  const std::uint8_t* a = image.row(y - 1) + x0;
  const std::uint8_t* b = image.row(y) + x0;
  const std::uint8_t* c = image.row(y + 1) + x0;
  for (int i = 0; i < n; ++i) {
    const int gx = (a[i + 1] - a[i - 1]) + 2 * (b[i + 1] - b[i - 1]) + (c[i + 1] - c[i - 1]);
    const int gy = (c[i - 1] + 2 * c[i] + c[i + 1]) - (a[i - 1] + 2 * a[i] + a[i + 1]);
    xx[i] = gx * gx;
    xy[i] = gx * gy;
    yy[i] = gy * gy;
  }
}

// The Harris measure of one row from the vertical sums; zero where the weaker gradient drowns in noise.
void harrisRow(const std::int32_t* xx, const std::int32_t* xy, const std::int32_t* yy, int n, float* out) {
  constexpr float kFloor = kMinGradient * kMinGradient * kSobelGain * kSobelGain * kBlock * kBlock;
  for (int i = 0; i < n; ++i) {
    const auto a = static_cast<float>(xx[i] + xx[i + 1] + xx[i + 2] + xx[i + 3] + xx[i + 4]);
    const auto b = static_cast<float>(xy[i] + xy[i + 1] + xy[i + 2] + xy[i + 3] + xy[i + 4]);
    const auto c = static_cast<float>(yy[i] + yy[i + 1] + yy[i + 2] + yy[i + 3] + yy[i + 4]);
    const float trace = a + c, determinant = a * c - b * b;
    const float response = determinant - kHarrisK * trace * trace;
    // determinant / trace lies between half of the smaller eigenvalue and that eigenvalue.
    out[i] = determinant > kFloor * trace ? std::max(response, 0.0F) : 0.0F;
  }
}

}  // namespace

const std::vector<Corner>& HarrisCorners::find(const GrayLevel& image, const PixelBox& box, int margin,
                                               int max_corners) {
  corners_.clear();
  const int inside = std::max(margin, 1);
  const PixelBox b{std::max(box.x0, inside), std::max(box.y0, inside),
                   std::min(box.x1, image.width() - inside), std::min(box.y1, image.height() - inside)};
  const int width = b.x1 - b.x0, height = b.y1 - b.y0;
  if (width < 1 || height < 1 || max_corners < 1) return corners_;

  Cells cells;
  const double edge = std::sqrt(kCornersPerCell * width * height / max_corners);  // [px]
  cells.columns = std::clamp(static_cast<int>(std::lround(width / edge)), 1, width);
  cells.rows = std::clamp(static_cast<int>(std::lround(height / edge)), 1, height);
  cells.width = static_cast<double>(width) / cells.columns;
  cells.height = static_cast<double>(height) / cells.rows;
  const std::size_t n = index(cells.columns) * index(cells.rows);
  ranked_.resize(n * kRanks);
  counts_.assign(n, 0);
  chosen_.assign(n, 0);
  scan(image, b, cells);
  select(cells, b, max_corners);
  return corners_;
}

void HarrisCorners::scan(const GrayLevel& image, const PixelBox& box, const Cells& cells) {
  // Responses one pixel around the box, gradients kHalf pixels around those.
  const int n = box.x1 - box.x0 + 2, m = n + 2 * kHalf;
  products_.resize(index(3 * kBlock * m));
  sums_.assign(index(3 * m), 0);
  responses_.resize(index(3 * n));
  const auto productRow = [&](int y) { return products_.data() + index(((y + kBlock) % kBlock) * 3 * m); };
  const auto responseRow = [&](int y) { return responses_.data() + index(((y + 3) % 3) * n); };
  const auto addRow = [&](int y, int sign) {
    const std::int32_t* p = productRow(y);
    for (int i = 0; i < 3 * m; ++i) sums_[index(i)] += sign * p[i];
  };
  const auto makeRow = [&](int y) {
    std::int32_t* p = productRow(y);
    gradientProducts(image, y, box.x0 - 1 - kHalf, m, p, p + m, p + 2 * m);
    addRow(y, 1);
  };

  for (int y = box.y0 - 1 - kHalf; y < box.y0 - 1 + kHalf; ++y) makeRow(y);
  for (int y = box.y0 - 1; y <= box.y1; ++y) {
    makeRow(y + kHalf);
    harrisRow(sums_.data(), sums_.data() + m, sums_.data() + 2 * m, n, responseRow(y));
    addRow(y - kHalf, -1);
    const int middle = y - 1;
    if (middle < box.y0) continue;
    const float* above = responseRow(middle - 1);
    const float* at = responseRow(middle);
    const float* below = responseRow(middle + 1);
    const std::size_t cell_row =
        index(std::min(static_cast<int>((middle - box.y0) / cells.height), cells.rows - 1)) *
        index(cells.columns);
    for (int i = 1; i < n - 1; ++i) {
      const float r = at[i];
      // Of equal neighbours the first in reading order wins.
      if (!(r > 0.0F) || r <= at[i - 1] || r < at[i + 1] || r <= above[i - 1] || r <= above[i] ||
          r <= above[i + 1] || r < below[i - 1] || r < below[i] || r < below[i + 1])
        continue;
      const std::size_t cell =
          cell_row + index(std::min(static_cast<int>((i - 1) / cells.width), cells.columns - 1));
      Corner* best = &ranked_[cell * kRanks];
      int rank = counts_[cell];
      if (rank == kRanks && r <= best[kRanks - 1].response) continue;
      if (rank < kRanks)
        counts_[cell] = static_cast<std::uint8_t>(rank + 1);
      else
        rank = kRanks - 1;
      for (; rank > 0 && best[rank - 1].response < r; --rank) best[rank] = best[rank - 1];
      best[rank] = {box.x0 + i - 1, middle, r};
    }
  }
}

bool HarrisCorners::clearOfChosen(const Corner& corner, const PixelBox& box, const Cells& cells,
                                  double distance) const {
  // The distance is shorter than a cell's edge, so only the eight cells around can hold a corner too close.
  const int column = std::min(static_cast<int>((corner.x - box.x0) / cells.width), cells.columns - 1);
  const int row = std::min(static_cast<int>((corner.y - box.y0) / cells.height), cells.rows - 1);
  for (int r = std::max(row - 1, 0); r <= std::min(row + 1, cells.rows - 1); ++r) {
    for (int c = std::max(column - 1, 0); c <= std::min(column + 1, cells.columns - 1); ++c) {
      const std::size_t cell = index(r) * index(cells.columns) + index(c);
      for (int k = 0; k < counts_[cell]; ++k) {
        if ((chosen_[cell] >> k & 1) == 0) continue;
        const Corner& other = ranked_[cell * kRanks + index(k)];
        const double dx = corner.x - other.x, dy = corner.y - other.y;
        if (dx * dx + dy * dy < distance * distance) return false;
      }
    }
  }
  return true;
}

void HarrisCorners::select(const Cells& cells, const PixelBox& box, int max_corners) {
  const double distance = kMinSpacing * std::sqrt(cells.width * cells.height / kCornersPerCell);  // [px]
  for (int rank = 0; rank < kRanks; ++rank) {
    turn_.clear();
    for (std::size_t cell = 0; cell < counts_.size(); ++cell)
      if (rank < counts_[cell]) turn_.push_back(static_cast<std::uint32_t>(cell));
    const auto response = [&](std::uint32_t cell) { return ranked_[cell * kRanks + index(rank)].response; };
    // The last turn may not reach every cell: the strongest come first.
    if (corners_.size() + turn_.size() > index(max_corners))
      std::stable_sort(turn_.begin(), turn_.end(),
                       [&](std::uint32_t a, std::uint32_t b) { return response(a) > response(b); });
    for (const std::uint32_t cell : turn_) {
      const Corner& corner = ranked_[cell * kRanks + index(rank)];
      if (!clearOfChosen(corner, box, cells, distance)) continue;
      chosen_[cell] = static_cast<std::uint16_t>(chosen_[cell] | 1U << rank);
      corners_.push_back(corner);
      if (static_cast<int>(corners_.size()) == max_corners) return;
    }
  }
}

}  // namespace fathom::stereo

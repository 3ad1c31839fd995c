#include "recon/stereo/gray_pyramid.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace fathom::stereo {
namespace {

constexpr int kSumRowPadding = 80;  // elements before and after a row of sums, which whole vectors may reach

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

constexpr int kRing = kBlock + 1;       // rows of gradients: a window's and the one that leaves it
constexpr int kMeasureRowPadding = 32;  // elements beyond a row, which whole vectors may reach

}  // namespace

void GrayLevel::resize(int width, int height) {
  width_ = width;
  height_ = height;
  stride_ = width + 2 * kBorder;
  pixels_.assign(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(height + 2 * kBorder), 0);
}

void GrayLevel::extendBorder() {
  for (int y = 0; y < height_; ++y) {
    std::uint8_t* r = row(y);
    std::memset(r - kBorder, r[0], kBorder);
    std::memset(r + width_, r[width_ - 1], kBorder);
  }
  const std::size_t bytes = static_cast<std::size_t>(stride_);
  for (int i = 1; i <= kBorder; ++i) {
    std::memcpy(row(-i) - kBorder, row(0) - kBorder, bytes);
    std::memcpy(row(height_ - 1 + i) - kBorder, row(height_ - 1) - kBorder, bytes);
  }
}

int GrayPyramid::levels(int width, int height, int wanted) {
  int count = 1;
  for (width = (width + 1) / 2, height = (height + 1) / 2;
       count < wanted && width >= kMinSide && height >= kMinSide; ++count) {
    width = (width + 1) / 2;
    height = (height + 1) / 2;
  }
  return count;
}

GrayPyramid::GrayPyramid(int width, int height, int levels, const Kernels& kernels) : kernels_(&kernels) {
  rows_.assign(static_cast<std::size_t>(width + 2 * kSumRowPadding), 0);
  for (int l = GrayPyramid::levels(width, height, levels); l > 0; --l) {
    levels_.emplace_back();
    levels_.back().resize(width, height);
    width = (width + 1) / 2;
    height = (height + 1) / 2;
  }
}

void GrayPyramid::build(const ImageView& image) {
  GrayLevel& base = levels_.front();
  const auto* source = static_cast<const std::uint8_t*>(image.data);
  for (int y = 0; y < base.height(); ++y)
    std::memcpy(base.row(y), source + static_cast<std::size_t>(y) * image.stride,
                static_cast<std::size_t>(base.width()));
  base.extendBorder();
  for (std::size_t l = 1; l < levels_.size(); ++l) halve(levels_[l - 1], levels_[l]);
}

void GrayPyramid::halve(const GrayLevel& fine, GrayLevel& coarse) {
  constexpr int kReach = 2;  // of the five taps
  std::uint16_t* sums = rows_.data() + kSumRowPadding;
  for (int y = 0; y < coarse.height(); ++y) {
    const std::uint8_t* rows[5];
    for (int i = 0; i < 5; ++i) rows[i] = fine.row(2 * y - kReach + i) - kReach;
    kernels_->smoothRows(rows, fine.width() + 2 * kReach, sums - kReach);
    kernels_->halveRow(sums, coarse.width(), coarse.row(y));
  }
  coarse.extendBorder();
}

HarrisCorners::HarrisCorners(int width, int max_corners, const Kernels& kernels)
    : kernels_(&kernels), width_(width), max_corners_(std::max(max_corners, 1)) {
  const std::size_t row = index(width + 2 * kHalf + 2 + kMeasureRowPadding), cells = index(max_corners_);
  gradients_.assign(2 * kRing * row, 0);
  sums_.assign(3 * row, 0);
  responses_.assign(3 * row, 0.0F);
  maxima_.assign(row, 0);
  cell_column_.assign(row, 0);
  ranked_.resize(cells * kRanks);
  counts_.reserve(cells);
  chosen_.reserve(cells);
  turn_.reserve(cells);
  corners_.reserve(cells);
}

const std::vector<Corner>& HarrisCorners::find(const GrayLevel& image, const PixelBox& box, int margin,
                                               int max_corners) {
  corners_.clear();
  const int inside = std::max(margin, 1);
  const PixelBox b{std::max(box.x0, inside), std::max(box.y0, inside),
                   std::min({box.x1, image.width() - inside, box.x0 + width_}),
                   std::min(box.y1, image.height() - inside)};
  const int width = b.x1 - b.x0, height = b.y1 - b.y0;
  const int wanted = std::min(max_corners, max_corners_);
  if (width < 1 || height < 1 || wanted < 1) return corners_;

  Cells cells;
  const double edge = std::sqrt(kCornersPerCell * width * height / wanted);  // [px]
  cells.columns = std::clamp(static_cast<int>(std::lround(width / edge)), 1, std::min(width, max_corners_));
  cells.rows = std::clamp(static_cast<int>(std::lround(height / edge)), 1,
                          std::min(height, max_corners_ / cells.columns));
  cells.width = static_cast<double>(width) / cells.columns;
  cells.height = static_cast<double>(height) / cells.rows;
  const std::size_t n = index(cells.columns) * index(cells.rows);
  counts_.assign(n, 0);
  chosen_.assign(n, 0);
  for (int i = 0; i < width; ++i)
    cell_column_[index(i)] = std::min(static_cast<int>(i / cells.width), cells.columns - 1);
  scan(image, b, cells);
  select(cells, b, wanted);
  return corners_;
}

void HarrisCorners::rank(int cell, const Corner& corner) {
  Corner* best = &ranked_[index(cell) * kRanks];
  int place = counts_[index(cell)];
  if (place == kRanks) {
    if (corner.response <= best[kRanks - 1].response) return;
    place = kRanks - 1;
  } else {
    counts_[index(cell)] = static_cast<std::uint8_t>(place + 1);
  }
  for (; place > 0 && best[place - 1].response < corner.response; --place) best[place] = best[place - 1];
  best[place] = corner;
}

void HarrisCorners::scan(const GrayLevel& image, const PixelBox& box, const Cells& cells) {
  // Responses one pixel around the box, gradients kHalf pixels around those.
  constexpr float kFloor = kMinGradient * kMinGradient * kSobelGain * kSobelGain * kBlock * kBlock;
  const int width = box.x1 - box.x0, n = width + 2, m = n + 2 * kHalf;
  const int row = m + kMeasureRowPadding;
  const auto gradients = [&](int y) { return gradients_.data() + index((y + kRing) % kRing * 2 * row); };
  const auto responses = [&](int y) { return responses_.data() + index((y + 3) % 3 * row); };
  std::int32_t *xx = sums_.data(), *xy = xx + row, *yy = xy + row;
  std::fill_n(xx, 3 * row, 0);
  std::fill_n(gradients_.data(), 2 * kRing * row, std::int16_t{0});
  const auto enter = [&](int y) {
    std::int16_t *in = gradients(y), *out = gradients(y - kBlock);
    const int x = box.x0 - 1 - kHalf;
    kernels_->gradientRow(image.row(y - 1) + x, image.row(y) + x, image.row(y + 1) + x, m, in, in + row);
    kernels_->tensorRow(in, in + row, out, out + row, m, xx, xy, yy);
  };

  for (int y = box.y0 - 1 - kHalf; y < box.y0 - 1 + kHalf; ++y) enter(y);
  for (int y = box.y0 - 1; y <= box.y1; ++y) {
    enter(y + kHalf);
    kernels_->harrisRow(xx, xy, yy, n, kHarrisK, kFloor, responses(y));
    const int middle = y - 1;
    if (middle < box.y0) continue;
    const float* at = responses(middle) + 1;
    const int count = kernels_->localMaxima(responses(middle - 1) + 1, at, responses(middle + 1) + 1, width,
                                            maxima_.data());
    const int first =
        std::min(static_cast<int>((middle - box.y0) / cells.height), cells.rows - 1) * cells.columns;
    for (int k = 0; k < count; ++k) {
      const int i = maxima_[index(k)];
      rank(first + cell_column_[index(i)], {box.x0 + i, middle, at[i]});
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
      std::sort(turn_.begin(), turn_.end(), [&](std::uint32_t a, std::uint32_t b) {
        const float ra = response(a), rb = response(b);
        return ra > rb || (ra == rb && a < b);
      });
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

#include "recon/stereo/gray_pyramid.hpp"

#include <cstring>

namespace fathom::stereo {
namespace {

constexpr int kSumRowPadding = 80;  // elements before and after a row of sums, which whole vectors may reach

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

}  // namespace fathom::stereo

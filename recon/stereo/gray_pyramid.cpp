#include "recon/stereo/gray_pyramid.hpp"

#include <cstring>

namespace fathom::stereo {

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

GrayPyramid::GrayPyramid(int width, int height, int levels) {
  rows_.resize(static_cast<std::size_t>(width + 2 * GrayLevel::kBorder));
  for (int l = 0; l < levels && (l == 0 || (width >= kMinSide && height >= kMinSide)); ++l) {
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
  std::uint16_t* sums = rows_.data() + GrayLevel::kBorder;
  for (int y = 0; y < coarse.height(); ++y) {
    const std::uint8_t* r0 = fine.row(2 * y - 2);
    const std::uint8_t* r1 = fine.row(2 * y - 1);
    const std::uint8_t* r2 = fine.row(2 * y);
    const std::uint8_t* r3 = fine.row(2 * y + 1);
    const std::uint8_t* r4 = fine.row(2 * y + 2);
    for (int x = -kReach; x < fine.width() + kReach; ++x)
      sums[x] = static_cast<std::uint16_t>(r0[x] + r4[x] + 4 * (r1[x] + r3[x]) + 6 * r2[x]);
    std::uint8_t* out = coarse.row(y);
    for (int x = 0; x < coarse.width(); ++x) {
      const std::uint16_t* s = sums + 2 * x;
      const int sum = s[-2] + s[2] + 4 * (s[-1] + s[1]) + 6 * s[0];
      out[x] = static_cast<std::uint8_t>((sum + 128) >> 8);
    }
  }
  coarse.extendBorder();
}

}  // namespace fathom::stereo

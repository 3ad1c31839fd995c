#include "recon/surface/band_image.hpp"

#include <cassert>
#include <utility>

namespace fathom::surface {
namespace {

RgbImage reduced(const RgbImage& in, int factor) {
  RgbImage out{in.width / factor, in.height / factor, {}};
  const auto n = static_cast<std::size_t>(factor), row = 3 * static_cast<std::size_t>(out.width);
  out.rgb.resize(row * static_cast<std::size_t>(out.height));
  std::vector<std::uint32_t> sums(row * n);
  const auto area = static_cast<std::uint32_t>(factor * factor);
  for (int y = 0; y < out.height; ++y) {
    std::fill(sums.begin(), sums.end(), 0U);
    for (int v = 0; v < factor; ++v) {
      const std::uint8_t* from = in.at(0, y * factor + v);
      for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += from[i];
    }
    std::uint8_t* to = out.at(0, y);
    for (std::size_t x = 0; x < static_cast<std::size_t>(out.width); ++x) {
      for (std::size_t c = 0; c < 3; ++c) {
        std::uint32_t sum = area / 2;
        for (std::size_t u = 0; u < n; ++u) sum += sums[3 * (x * n + u) + c];
        to[3 * x + c] = static_cast<std::uint8_t>(sum / area);
      }
    }
  }
  return out;
}

// (-5 74 -5)/64 down, then across; at the borders the last pixel is repeated.
RgbImage restored(const RgbImage& in) {
  constexpr int kMiddle = 74, kBeside = 5, kHalf = 32, kShift = 6;
  RgbImage out{in.width, in.height, std::vector<std::uint8_t>(in.rgb.size())};
  const auto samples = 3 * static_cast<std::size_t>(in.width);
  std::vector<std::int16_t> down(samples + 6);  // a pixel more on either side
  for (int y = 0; y < in.height; ++y) {
    const std::uint8_t *above = in.at(0, std::max(y - 1, 0)), *row = in.at(0, y);
    const std::uint8_t* below = in.at(0, std::min(y + 1, in.height - 1));
    std::int16_t* middle = down.data() + 3;
    for (std::size_t i = 0; i < samples; ++i)
      middle[i] = static_cast<std::int16_t>(
          static_cast<std::int16_t>(kMiddle * row[i] - kBeside * (above[i] + below[i]) + kHalf) >> kShift);
    for (std::size_t c = 0; c < 3; ++c) {
      down[c] = middle[c];
      middle[samples + c] = middle[samples - 3 + c];
    }
    std::uint8_t* to = out.at(0, y);
    for (std::size_t i = 0; i < samples; ++i) {
      const auto value = static_cast<std::int16_t>(
          static_cast<std::int16_t>(kMiddle * down[i + 3] - kBeside * (down[i] + down[i + 6]) + kHalf) >>
          kShift);
      to[i] = static_cast<std::uint8_t>(value < 0 ? 0 : (value > 255 ? 255 : value));
    }
  }
  return out;
}

// Means of squares; the last square of a row or column may be cut by the image's border.
LowPass meansOf(const RgbImage& in, int scale) {
  LowPass out{(in.width + scale - 1) / scale, (in.height + scale - 1) / scale, scale, {}};
  const auto width = static_cast<std::size_t>(out.width), n = static_cast<std::size_t>(scale);
  const std::size_t samples = 3 * static_cast<std::size_t>(in.width);
  out.values.resize(4 * width * static_cast<std::size_t>(out.height));
  std::vector<std::uint16_t> sums(3 * width * n);
  for (int y = 0; y < out.height; ++y) {
    const int rows = std::min(scale, in.height - y * scale);
    std::fill(sums.begin(), sums.end(), std::uint16_t{0});
    for (int v = 0; v < rows; ++v) {
      const std::uint8_t* from = in.at(0, y * scale + v);
      for (std::size_t i = 0; i < samples; ++i) sums[i] = static_cast<std::uint16_t>(sums[i] + from[i]);
    }
    std::uint16_t* to = &out.values[4 * width * static_cast<std::size_t>(y)];
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t columns = std::min(n, static_cast<std::size_t>(in.width) - x * n);
      const float unit =
          static_cast<float>(LowPass::kUnit) / static_cast<float>(columns * static_cast<std::size_t>(rows));
      std::uint32_t sum[3] = {0, 0, 0};
      for (std::size_t u = 0; u < columns; ++u)
        for (std::size_t c = 0; c < 3; ++c) sum[c] += sums[3 * (x * n + u) + c];
      for (std::size_t c = 0; c < 3; ++c)
        to[4 * x + c] = static_cast<std::uint16_t>(static_cast<float>(sum[c]) * unit + 0.5F);
    }
  }
  return out;
}

LowPass meansOf(const LowPass& in, int factor) {
  LowPass out{(in.width + factor - 1) / factor, (in.height + factor - 1) / factor, in.scale * factor, {}};
  out.values.resize(4 * static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height));
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      std::uint32_t sum[4] = {0, 0, 0, 0}, count = 0;
      for (int v = y * factor; v < std::min(in.height, (y + 1) * factor); ++v) {
        for (int u = x * factor; u < std::min(in.width, (x + 1) * factor); ++u, ++count) {
          const std::size_t from = 4 * (static_cast<std::size_t>(v) * static_cast<std::size_t>(in.width) +
                                        static_cast<std::size_t>(u));
          for (std::size_t c = 0; c < 4; ++c) sum[c] += in.values[from + c];
        }
      }
      const std::size_t to = 4 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(out.width) +
                                  static_cast<std::size_t>(x));
      for (std::size_t c = 0; c < 4; ++c)
        out.values[to + c] = static_cast<std::uint16_t>((sum[c] + count / 2) / count);
    }
  }
  return out;
}

// (1 4 6 4 1)/16 of values `step` apart; beyond the ends the last value is repeated.
std::uint16_t binomial(const std::uint16_t* at, int place, int count, std::ptrdiff_t step) {
  const auto value = [&](int offset) -> std::uint32_t {
    return at[(std::clamp(place + offset, 0, count - 1) - place) * step];
  };
  return static_cast<std::uint16_t>((value(-2) + value(2) + 4 * (value(-1) + value(1)) + 6 * value(0) + 8) >>
                                    4);
}

void smooth(LowPass& pass) {
  std::vector<std::uint16_t> along(pass.values.size());
  const auto row = static_cast<std::ptrdiff_t>(4) * pass.width;
  for (int y = 0; y < pass.height; ++y) {
    const std::uint16_t* from = pass.values.data() + y * row;
    std::uint16_t* to = along.data() + y * row;
    for (int x = 0; x < pass.width; ++x) {
      if (x >= 2 && x < pass.width - 2) {  // the same without looking for the ends
        for (int c = 0; c < 4; ++c) {
          const std::uint16_t* p = from + 4 * x + c;
          to[4 * x + c] = static_cast<std::uint16_t>(
              (p[-8] + p[8] + 4U * (static_cast<std::uint32_t>(p[-4]) + p[4]) + 6U * p[0] + 8U) >> 4);
        }
      } else {
        for (int c = 0; c < 4; ++c) to[4 * x + c] = binomial(from + 4 * x + c, x, pass.width, 4);
      }
    }
  }
  for (int y = 0; y < pass.height; ++y) {
    const auto rowAt = [&](int offset) {
      return along.data() + std::clamp(y + offset, 0, pass.height - 1) * row;
    };
    const std::uint16_t *a = rowAt(-2), *b = rowAt(-1), *c = rowAt(0), *d = rowAt(1), *e = rowAt(2);
    std::uint16_t* to = pass.values.data() + y * row;
    for (std::ptrdiff_t i = 0; i < row; ++i)
      to[i] = static_cast<std::uint16_t>(
          (a[i] + e[i] + 4U * (static_cast<std::uint32_t>(b[i]) + d[i]) + 6U * c[i] + 8U) >> 4);
  }
}

}  // namespace

BandImage makeBands(RgbImage image, const BandWidths& widths, std::shared_ptr<const ImageMask> mask) {
  assert(widths.fine >= 2 && widths.fine <= 16 && widths.coarse >= 2 && widths.reduction >= 1);
  assert(image.width >= widths.reduction && image.height >= widths.reduction);
  BandImage out;
  out.mask = std::move(mask);
  out.reduction = widths.reduction;
  out.image = widths.reduction > 1 ? reduced(image, widths.reduction) : std::move(image);
  if (widths.restore) out.image = restored(out.image);
  out.fine = meansOf(out.image, widths.fine);
  smooth(out.fine);
  out.coarse = meansOf(out.fine, widths.coarse);
  smooth(out.coarse);
  return out;
}

}  // namespace fathom::surface

#include "recon/surface/texture_measures.hpp"

#include <cassert>
#include <cmath>
#include <cstdlib>

namespace fathom::surface {
namespace {

// visit(a, b, pixel a, pixel b) for every pair of texels beside and below each other.
template <typename Visit>
void forEachPair(const RgbImage& texture, const Visit& visit) {
  for (int y = 0; y < texture.height; ++y) {
    for (int x = 0; x < texture.width; ++x) {
      const std::size_t a =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(texture.width) + static_cast<std::size_t>(x);
      if (x + 1 < texture.width) visit(a, a + 1, texture.at(x, y), texture.at(x + 1, y));
      if (y + 1 < texture.height)
        visit(a, a + static_cast<std::size_t>(texture.width), texture.at(x, y), texture.at(x, y + 1));
    }
  }
}

}  // namespace

SeamMeasure& SeamMeasure::operator+=(const SeamMeasure& other) {
  const auto join = [](double a, std::uint64_t n, double b, std::uint64_t m) {
    return n + m == 0
               ? 0.0
               : (a * static_cast<double>(n) + b * static_cast<double>(m)) / static_cast<double>(n + m);
  };
  across = join(across, pairs_across, other.across, other.pairs_across);
  inside = join(inside, pairs_inside, other.inside, other.pairs_inside);
  pairs_across += other.pairs_across;
  pairs_inside += other.pairs_inside;
  return *this;
}

SeamMeasure measureSeams(const RgbImage& texture, const std::vector<std::uint64_t>& region) {
  assert(region.size() * 3 == texture.rgb.size());
  SeamMeasure out;
  double across = 0, inside = 0;
  forEachPair(texture, [&](std::size_t a, std::size_t b, const std::uint8_t* p, const std::uint8_t* q) {
    if (region[a] == kNoRegion || region[b] == kNoRegion) return;
    const double step = (std::abs(p[0] - q[0]) + std::abs(p[1] - q[1]) + std::abs(p[2] - q[2])) / 3.0;
    const bool border = region[a] != region[b];
    (border ? across : inside) += step;
    ++(border ? out.pairs_across : out.pairs_inside);
  });
  if (out.pairs_across > 0) out.across = across / static_cast<double>(out.pairs_across);
  if (out.pairs_inside > 0) out.inside = inside / static_cast<double>(out.pairs_inside);
  return out;
}

GradientEnergy gradientEnergy(const RgbImage& texture, const std::vector<std::uint8_t>& counts) {
  assert(counts.size() * 3 == texture.rgb.size());
  GradientEnergy out;
  const auto width = static_cast<std::size_t>(texture.width);
  constexpr double kPerTexel = 1.0 / 8;  // of Sobel's weights
  for (std::size_t y = 1; y + 1 < static_cast<std::size_t>(texture.height); ++y) {
    for (std::size_t x = 1; x + 1 < width; ++x) {
      bool all = true;
      for (std::size_t v = y - 1; v <= y + 1; ++v)
        for (std::size_t u = x - 1; u <= x + 1; ++u) all &= counts[v * width + u] != 0;
      if (!all) continue;
      for (std::size_t c = 0; c < 3; ++c) {
        const auto at = [&](std::size_t u, std::size_t v) -> int {
          return texture.rgb[3 * (v * width + u) + c];
        };
        const int gx = at(x + 1, y - 1) + 2 * at(x + 1, y) + at(x + 1, y + 1) - at(x - 1, y - 1) -
                       2 * at(x - 1, y) - at(x - 1, y + 1);
        const int gy = at(x - 1, y + 1) + 2 * at(x, y + 1) + at(x + 1, y + 1) - at(x - 1, y - 1) -
                       2 * at(x, y - 1) - at(x + 1, y - 1);
        out.sum += kPerTexel * kPerTexel * (gx * gx + gy * gy) / 3.0;
      }
      ++out.texels;
    }
  }
  return out;
}

}  // namespace fathom::surface

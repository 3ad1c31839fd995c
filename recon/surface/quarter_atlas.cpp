#include <cassert>

#include "recon/surface/atlas.hpp"

namespace fathom::surface {
namespace {

constexpr int kQuarter = 4;

}  // namespace

TexturedTile quarterAtlas(const TexturedTile& tile) {
  const RgbImage& fine = tile.atlas;
  assert(fine.width % kQuarter == 0 && fine.height % kQuarter == 0);
  TexturedTile out{tile.surface, {fine.width / kQuarter, fine.height / kQuarter, {}}, tile.texel * kQuarter};
  out.atlas.rgb.resize(3 * static_cast<std::size_t>(out.atlas.width) *
                       static_cast<std::size_t>(out.atlas.height));
  for (int y = 0; y < out.atlas.height; ++y) {
    for (int x = 0; x < out.atlas.width; ++x) {
      std::array<unsigned, 3> sum{};
      for (int v = 0; v < kQuarter; ++v) {
        const std::uint8_t* row = fine.at(kQuarter * x, kQuarter * y + v);
        for (std::size_t u = 0; u < kQuarter; ++u)
          for (std::size_t c = 0; c < 3; ++c) sum[c] += row[3 * u + c];
      }
      constexpr unsigned kTexels = kQuarter * kQuarter;
      for (std::size_t c = 0; c < 3; ++c)
        out.atlas.at(x, y)[c] = static_cast<std::uint8_t>((sum[c] + kTexels / 2) / kTexels);
    }
  }
  return out;
}

}  // namespace fathom::surface

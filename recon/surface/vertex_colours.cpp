#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>

#include "recon/surface/atlas.hpp"

namespace fathom::surface {
namespace {

constexpr int kMostSamples = 16;  // along the longest edge of a face
constexpr float kNear = 0.5F;     // share of a corner, above which a place of the face is the corner's

struct Mean {
  std::array<float, 3> sum{};
  float count = 0;
};

// Vertices at charts' seams stand twice.
std::array<std::uint32_t, 3> placeOf(const Eigen::Vector3f& p) {
  return {std::bit_cast<std::uint32_t>(p.x() + 0.0F), std::bit_cast<std::uint32_t>(p.y() + 0.0F),
          std::bit_cast<std::uint32_t>(p.z() + 0.0F)};
}

}  // namespace

void colourVertices(TexturedTile& tile) {
  Mesh& mesh = tile.surface.mesh;
  const RgbImage& atlas = tile.atlas;
  std::map<std::array<std::uint32_t, 3>, Mean> means;
  for (const auto& t : mesh.triangles) {
    std::array<Mean*, 3> corner;
    std::array<Eigen::Vector2f, 3> texel;
    for (std::size_t k = 0; k < 3; ++k) {
      corner[k] = &means[placeOf(mesh.vertices[t[k]])];
      const Eigen::Vector2f& st = mesh.texture_coordinates[t[k]];
      texel[k] = {st.x() * static_cast<float>(atlas.width), (1 - st.y()) * static_cast<float>(atlas.height)};
    }
    const float longest =
        std::max({(texel[0] - texel[1]).norm(), (texel[1] - texel[2]).norm(), (texel[2] - texel[0]).norm()});
    const int n = std::clamp(static_cast<int>(std::ceil(longest)), 2, kMostSamples);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n - i; ++j) {
        const auto whole = static_cast<float>(n);
        const float a = (static_cast<float>(i) + 1.0F / 3) / whole,
                    b = (static_cast<float>(j) + 1.0F / 3) / whole;
        const std::array<float, 3> share{1 - a - b, a, b};
        const auto most =
            static_cast<std::size_t>(std::max_element(share.begin(), share.end()) - share.begin());
        if (share[most] < kNear) continue;
        const Eigen::Vector2f at = share[0] * texel[0] + a * texel[1] + b * texel[2];
        const std::uint8_t* colour = atlas.at(std::clamp(static_cast<int>(at.x()), 0, atlas.width - 1),
                                              std::clamp(static_cast<int>(at.y()), 0, atlas.height - 1));
        for (std::size_t c = 0; c < 3; ++c) corner[most]->sum[c] += static_cast<float>(colour[c]);
        corner[most]->count += 1;
      }
  }
  mesh.colours.resize(mesh.vertices.size());
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const auto found = means.find(placeOf(mesh.vertices[v]));
    if (found == means.end() || found->second.count == 0) continue;
    for (std::size_t c = 0; c < 3; ++c)
      mesh.colours[v][c] = static_cast<std::uint8_t>(std::lround(found->second.sum[c] / found->second.count));
  }
}

}  // namespace fathom::surface

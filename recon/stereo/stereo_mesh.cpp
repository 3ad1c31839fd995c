#include <algorithm>
#include <cmath>
#include <cstddef>

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {
namespace {

// Bilinear colour at a pixel of an 8-bit RGB or mono image.
Rgb colourAt(const ImageView& image, const Eigen::Vector2f& pixel) {
  const std::size_t channels = image.format == PixelFormat::kRgb ? 3 : 1;
  const float x = std::clamp(pixel.x(), 0.0F, static_cast<float>(image.width - 1));
  const float y = std::clamp(pixel.y(), 0.0F, static_cast<float>(image.height - 1));
  const int x0 = std::min(static_cast<int>(x), std::max(image.width - 2, 0));
  const int y0 = std::min(static_cast<int>(y), std::max(image.height - 2, 0));
  const int x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
  const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
  const auto* bytes = static_cast<const std::uint8_t*>(image.data);
  const auto value = [&](int column, int row, std::size_t channel) {
    return static_cast<float>(bytes[static_cast<std::size_t>(row) * image.stride +
                                    static_cast<std::size_t>(column) * channels + channel]);
  };
  Rgb colour{};
  for (std::size_t c = 0; c < 3; ++c) {
    const std::size_t k = channels == 3 ? c : 0;
    const float top = value(x0, y0, k) * (1 - fx) + value(x1, y0, k) * fx;
    const float bottom = value(x0, y1, k) * (1 - fx) + value(x1, y1, k) * fx;
    colour[c] = static_cast<std::uint8_t>(std::lround(top * (1 - fy) + bottom * fy));
  }
  return colour;
}

}  // namespace

void toMesh(const StereoResult& result, const ImageView& left_rgb, Mesh& mesh) {
  const bool coloured = !left_rgb.empty() && left_rgb.bits == 8 && left_rgb.format != PixelFormat::kBayerRggb;
  mesh.vertices.clear();
  mesh.colours.clear();
  mesh.texture_coordinates.clear();
  mesh.sigma.clear();
  for (const StereoPoint& p : result.points) {
    mesh.vertices.push_back(p.point);
    mesh.sigma.push_back(p.sigma_z);
    if (coloured) mesh.colours.push_back(colourAt(left_rgb, p.left));
  }
  mesh.triangles.assign(result.triangles.begin(), result.triangles.end());
  computeNormals(mesh);
}

Mesh toMesh(const StereoResult& result, const ImageView& left_rgb) {
  Mesh mesh;
  toMesh(result, left_rgb, mesh);
  return mesh;
}

}  // namespace fathom::stereo

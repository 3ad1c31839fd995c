#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {
namespace {

// Points stand where contrast is strongest, and single pixels are noisy: the mean of an 8-bit RGB or mono
// image over a square about a pixel, of a grid of kAcross x kAcross pixels.
constexpr int kAcross = 7;

Rgb colourAbout(const ImageView& image, const Eigen::Vector2f& pixel, int step) {
  const std::size_t channels = image.format == PixelFormat::kRgb ? 3 : 1;
  const auto* bytes = static_cast<const std::uint8_t*>(image.data);
  const auto middle = [](float at, int size) {
    return static_cast<int>(std::lround(std::clamp(at, 0.0F, static_cast<float>(size - 1))));
  };
  const int x = middle(pixel.x(), image.width), y = middle(pixel.y(), image.height), half = kAcross / 2;
  std::array<std::uint32_t, 3> sums{};
  std::uint32_t count = 0;
  for (int j = -half; j <= half; ++j) {
    const int row = y + j * step;
    if (row < 0 || row >= image.height) continue;
    for (int i = -half; i <= half; ++i) {
      const int column = x + i * step;
      if (column < 0 || column >= image.width) continue;
      const std::uint8_t* at =
          bytes + static_cast<std::size_t>(row) * image.stride + static_cast<std::size_t>(column) * channels;
      for (std::size_t c = 0; c < 3; ++c) sums[c] += at[channels == 3 ? c : 0];
      ++count;
    }
  }
  Rgb colour{};
  for (std::size_t c = 0; c < 3; ++c) colour[c] = static_cast<std::uint8_t>((sums[c] + count / 2) / count);
  return colour;
}

// Half of what one point stands for.
int colourStep(const ImageView& image, std::size_t points) {
  const double spacing = std::sqrt(static_cast<double>(image.width) * image.height /
                                   static_cast<double>(std::max<std::size_t>(points, 1)));
  constexpr int kMost = 5;
  return std::clamp(static_cast<int>(0.5 * spacing / kAcross), 1, kMost);
}

}  // namespace

void toMesh(const StereoResult& result, const ImageView& left_rgb, Mesh& mesh) {
  const bool coloured = !left_rgb.empty() && left_rgb.bits == 8 && left_rgb.format != PixelFormat::kBayerRggb;
  const int step = coloured ? colourStep(left_rgb, result.points.size()) : 1;
  mesh.vertices.clear();
  mesh.colours.clear();
  mesh.texture_coordinates.clear();
  mesh.sigma.clear();
  for (const StereoPoint& p : result.points) {
    mesh.vertices.push_back(p.point);
    mesh.sigma.push_back(p.sigma_z);
    if (coloured) mesh.colours.push_back(colourAbout(left_rgb, p.left, step));
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

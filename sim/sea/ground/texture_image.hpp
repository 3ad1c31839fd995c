#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::sim {

// A picture that colours a mesh, with half-size levels so that it never aliases.
class TextureImage {
 public:
  // Reads any image that OpenCV reads; throws InputError.
  explicit TextureImage(const std::filesystem::path& path);
  // Of sRGB pixels, row after row; at least 2 x 2.
  TextureImage(int width, int height, const std::vector<std::uint8_t>& rgb);

  // Linear red, green, blue at (s, t), t upwards (row = (1 - t) * height); `texels`: footprint of a pixel at
  // level 0.
  [[nodiscard]] std::array<float, 3> sample(const Eigen::Vector2f& st, float texels) const;

  [[nodiscard]] int width() const { return levels_[0].width; }
  [[nodiscard]] int height() const { return levels_[0].height; }

 private:
  struct Level {
    int width = 0, height = 0;
    std::vector<std::uint8_t> rgb;
  };
  std::vector<Level> levels_;
};

// sRGB byte to linear, 0 to 1 (IEC 61966-2-1), and back.
[[nodiscard]] float linearFromSrgb(std::uint8_t value);
[[nodiscard]] std::uint8_t srgbFromLinear(double value);
[[nodiscard]] Rgb srgbFromLinear(const Eigen::Vector3d& linear);

}  // namespace fathom::sim

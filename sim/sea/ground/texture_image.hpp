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

// Albedo of a seafloor of any size, synthesised from photographs: rotated and mirrored pieces on a triangular
// lattice, with variance-preserving blending (Heitz and Neyret 2018). The photographs' uneven illumination is
// removed first.
class AlbedoImages {
 public:
  // Every image in `folder`, `pixel_m` of ground a pixel [m]; `contrast` times as strong. Throws InputError
  // for a folder without images, or images too small to cut pieces from.
  AlbedoImages(const std::filesystem::path& folder, double pixel_m, double contrast, std::uint64_t seed);

  // Linear red, green, blue at a place [m] of a surface with that normal for a pixel of `footprint_m`:
  // projected from above where the slope is below 33 degrees, from the sides where it is steeper.
  [[nodiscard]] std::array<float, 3> at(const Eigen::Vector3f& place, const Eigen::Vector3f& normal,
                                        float footprint_m) const;

 private:
  [[nodiscard]] std::array<float, 3> inPlane(const Eigen::Vector2f& place, float footprint_m) const;
  [[nodiscard]] std::array<float, 3> piece(const Eigen::Vector2i& node, const Eigen::Vector2f& from_node,
                                           float texels) const;

  std::vector<TextureImage> images_;
  std::array<float, 3> mean_{};
  float pixel_m_, contrast_;
  std::uint64_t seed_;
};

}  // namespace fathom::sim

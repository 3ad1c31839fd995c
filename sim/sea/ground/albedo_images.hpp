#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "sim/sea/ground/texture_image.hpp"

namespace fathom::sim {

// The albedo of a seafloor of any size from photographs of real ones: pieces of them, turned and mirrored, on
// a lattice of triangles, blended so that contrast stays (Heitz and Neyret 2018: by-example noise with
// variance-preserving blending). The photographs' uneven light is taken out first.
class AlbedoImages {
 public:
  // Every image in `folder`, `pixel_m` of ground a pixel [m]; `contrast` times as strong. Throws InputError
  // for a folder without images, or images too small to cut pieces from.
  AlbedoImages(const std::filesystem::path& folder, double pixel_m, double contrast, std::uint64_t seed);

  // Linear red, green, blue at a place [m] of a surface with that normal, as a pixel of `footprint_m` sees
  // it: laid on from above where it slopes by less than 33 degrees, from the sides on what is steeper.
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

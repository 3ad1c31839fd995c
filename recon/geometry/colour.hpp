#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom {

// sRGB (IEC 61966-2-1), 0 to 1, to linear light.
[[nodiscard]] double linearFromSrgb(double srgb);
[[nodiscard]] double linearFromSrgb(std::uint8_t level);  // by a table, the same
[[nodiscard]] double srgbFromLinear(double linear);

// Relative luminance, linear, 0 to 1 (CIE Y).
[[nodiscard]] double luminanceOf(const Rgb& srgb);
// CIE L*a*b* (D65, 2 degrees) of linear sRGB, 0 to 1.
[[nodiscard]] Eigen::Vector3d labOf(const Eigen::Vector3d& linear);
// CIEDE2000, after Sharma, Wu and Dalal 2005, "The CIEDE2000 color-difference formula", Color Res. Appl. 30.
[[nodiscard]] double ciede2000(const Eigen::Vector3d& lab_a, const Eigen::Vector3d& lab_b);

// Matrix from a camera's colours to sRGB, in FILE.colour beside its calibration FILE: nine numbers, row after
// row; rows add up to 1, so that grey stays grey.
[[nodiscard]] std::filesystem::path coloursBeside(const std::filesystem::path& calibration);
// std::nullopt without such a file. Throws InputError for other content.
[[nodiscard]] std::optional<Eigen::Matrix3d> readColours(const std::filesystem::path& calibration);
void writeColours(const std::filesystem::path& colour_file, const Eigen::Matrix3d& matrix);

// Applies such a matrix to 8-bit sRGB in linear light, by tables. Allocates nothing after its constructor.
class ColourMatrix {
 public:
  explicit ColourMatrix(const Eigen::Matrix3d& matrix);
  // To pixels of three samples each.
  void apply(std::span<std::uint8_t> rgb) const;

 private:
  static constexpr int kSteps = 4096;
  Eigen::Matrix3f matrix_;
  std::array<float, 256> linear_{};
  std::vector<std::uint8_t> srgb_;  // of linear light in kSteps steps
};

}  // namespace fathom

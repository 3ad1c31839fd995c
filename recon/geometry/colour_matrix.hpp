#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

namespace fathom {

// A camera's colours to sRGB: nine numbers beside its calibration, FILE.colour, row after row; rows add up to
// 1, so that grey stays grey.
[[nodiscard]] std::filesystem::path coloursBeside(const std::filesystem::path& calibration);
// None where there is no such file. Throws InputError for one that holds anything else.
[[nodiscard]] std::optional<Eigen::Matrix3d> readColours(const std::filesystem::path& calibration);
void writeColours(const std::filesystem::path& file, const Eigen::Matrix3d& matrix);

// Takes 8-bit sRGB through a matrix in linear light, by tables. Allocates nothing after its
// constructor.
class ColourMatrix {
 public:
  explicit ColourMatrix(const Eigen::Matrix3d& matrix);
  // Of pixels, three samples each.
  void apply(std::span<std::uint8_t> rgb) const;

 private:
  static constexpr int kSteps = 4096;
  Eigen::Matrix3f matrix_;
  std::array<float, 256> linear_{};
  std::vector<std::uint8_t> srgb_;  // of linear light in steps
};

}  // namespace fathom

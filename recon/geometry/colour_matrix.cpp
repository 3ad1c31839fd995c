#include "recon/geometry/colour_matrix.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/colour_difference.hpp"
#include "recon/geometry/number_file.hpp"

namespace fathom {

std::filesystem::path coloursBeside(const std::filesystem::path& calibration) {
  return calibration.string() + ".colour";
}

std::optional<Eigen::Matrix3d> readColours(const std::filesystem::path& calibration) {
  const std::filesystem::path path = coloursBeside(calibration);
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::nullopt;
  constexpr std::size_t kNumbers = 9;
  NumberFile in(path, "nine numbers, a 3 x 3 matrix row after row");
  if (in.count() != kNumbers)
    throw InputError(path, "", "holds " + std::to_string(in.count()) + " numbers; a colour matrix has 9");
  Eigen::Matrix3d matrix;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) matrix(row, column) = in.next();
  constexpr double kRounded = 1e-3, kMost = 10;
  if (!matrix.allFinite() || (matrix.rowwise().sum().array() - 1).abs().maxCoeff() > kRounded ||
      matrix.cwiseAbs().maxCoeff() > kMost)
    in.fail("each row of a colour matrix adds up to 1; make it by fathom-topside calibrate-colour");
  return matrix;
}

void writeColours(const std::filesystem::path& file, const Eigen::Matrix3d& matrix) {
  AtomicFile out(file);
  out.stream() << std::setprecision(9) << matrix << '\n';
  out.commit();
}

ColourMatrix::ColourMatrix(const Eigen::Matrix3d& matrix) : matrix_(matrix.cast<float>()), srgb_(kSteps + 1) {
  for (std::size_t k = 0; k < linear_.size(); ++k)
    linear_[k] = static_cast<float>(linearFromSrgb(static_cast<double>(k) / 255));
  // The nearest level of each step.
  std::size_t level = 0;
  for (int k = 0; k <= kSteps; ++k) {
    const float light = static_cast<float>(k) / kSteps;
    while (level < 255 && light > 0.5F * (linear_[level] + linear_[level + 1])) ++level;
    srgb_[static_cast<std::size_t>(k)] = static_cast<std::uint8_t>(level);
  }
}

void ColourMatrix::apply(std::span<std::uint8_t> rgb) const {
  for (std::size_t k = 0; k + 2 < rgb.size(); k += 3) {
    std::uint8_t* pixel = &rgb[k];
    const Eigen::Vector3f light =
        matrix_ * Eigen::Vector3f(linear_[pixel[0]], linear_[pixel[1]], linear_[pixel[2]]);
    for (int c = 0; c < 3; ++c)
      pixel[c] = srgb_[static_cast<std::size_t>(std::lround(kSteps * std::clamp(light(c), 0.0F, 1.0F)))];
  }
}

}  // namespace fathom

#include "recon/geometry/colour.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iomanip>
#include <numbers>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom {

double linearFromSrgb(double srgb) {
  constexpr double kKnee = 0.04045;
  return srgb <= kKnee ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
}

double linearFromSrgb(std::uint8_t level) {
  static const auto kTable = [] {
    std::array<double, 256> table{};
    for (std::size_t k = 0; k < table.size(); ++k) table[k] = linearFromSrgb(static_cast<double>(k) / 255);
    return table;
  }();
  return kTable[level];
}

double srgbFromLinear(double linear) {
  constexpr double kKnee = 0.0031308;
  return linear <= kKnee ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

double luminanceOf(const Rgb& srgb) {
  const auto linear = [&](std::size_t c) { return linearFromSrgb(srgb[c]); };
  return 0.2126 * linear(0) + 0.7152 * linear(1) + 0.0722 * linear(2);
}

Eigen::Vector3d labOf(const Eigen::Vector3d& linear) {
  Eigen::Matrix3d xyz_from_rgb;  // IEC 61966-2-1
  xyz_from_rgb << 0.4124564, 0.3575761, 0.1804375, 0.2126729, 0.7151522, 0.0721750, 0.0193339, 0.1191920,
      0.9503041;
  const Eigen::Vector3d white(0.95047, 1.0, 1.08883);
  const Eigen::Vector3d t = (xyz_from_rgb * linear).cwiseQuotient(white);
  constexpr double kKnee = 6.0 / 29;
  const auto f = [](double v) {
    return v > kKnee * kKnee * kKnee ? std::pow(v, 1.0 / 3) : v / (3 * kKnee * kKnee) + 4.0 / 29;
  };
  const double x = f(t.x()), y = f(t.y()), z = f(t.z());
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

double ciede2000(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  constexpr double kTurn = 2 * std::numbers::pi;
  constexpr double k25To7 = 6103515625.0;
  const auto squashed = [](double chroma) {
    const double c7 = std::pow(chroma, 7);
    return std::sqrt(c7 / (c7 + k25To7));
  };
  const double mean_c = 0.5 * (hypotenuse(a.y(), a.z()) + hypotenuse(b.y(), b.z()));
  const double g = 0.5 * (1 - squashed(mean_c));
  const double a1 = (1 + g) * a.y(), a2 = (1 + g) * b.y();
  const double c1 = hypotenuse(a1, a.z()), c2 = hypotenuse(a2, b.z());
  const auto hueOf = [](double x, double y) {
    const double h = x == 0 && y == 0 ? 0 : std::atan2(y, x);
    return h < 0 ? h + kTurn : h;
  };
  const double h1 = hueOf(a1, a.z()), h2 = hueOf(a2, b.z());
  const bool grey = c1 * c2 == 0;
  double dh = grey ? 0 : h2 - h1;
  if (dh > std::numbers::pi) dh -= kTurn;
  if (dh < -std::numbers::pi) dh += kTurn;
  const double dl = b.x() - a.x(), dc = c2 - c1, dH = 2 * std::sqrt(c1 * c2) * std::sin(0.5 * dh);
  const double l = 0.5 * (a.x() + b.x()), c = 0.5 * (c1 + c2);
  double h = h1 + h2;
  if (!grey) {
    if (std::abs(h1 - h2) > std::numbers::pi) h += h < kTurn ? kTurn : -kTurn;
    h *= 0.5;
  }
  const double t = 1 - 0.17 * std::cos(h - 30 * kRadiansPerDegree) + 0.24 * std::cos(2 * h) +
                   0.32 * std::cos(3 * h + 6 * kRadiansPerDegree) -
                   0.20 * std::cos(4 * h - 63 * kRadiansPerDegree);
  const double turn = 30 * kRadiansPerDegree * std::exp(-std::pow((h / kRadiansPerDegree - 275) / 25, 2));
  const double off = (l - 50) * (l - 50);
  const double sl = 1 + 0.015 * off / std::sqrt(20 + off), sc = 1 + 0.045 * c, sh = 1 + 0.015 * c * t;
  const double rt = -std::sin(2 * turn) * 2 * squashed(c);
  const double x = dl / sl, y = dc / sc, z = dH / sh;
  return std::sqrt(std::max(0.0, x * x + y * y + z * z + rt * y * z));
}

std::filesystem::path coloursBeside(const std::filesystem::path& calibration) {
  return calibration.string() + ".colour";
}

std::optional<Eigen::Matrix3d> readColours(const std::filesystem::path& calibration) {
  const std::filesystem::path path = coloursBeside(calibration);
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::nullopt;
  constexpr std::size_t kMatrixNumbers = 9;
  NumberFile in(path, "nine numbers, a 3 x 3 matrix row after row");
  if (in.count() != kMatrixNumbers)
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

void writeColours(const std::filesystem::path& colour_file, const Eigen::Matrix3d& matrix) {
  AtomicFile out(colour_file);
  out.stream() << std::setprecision(9) << matrix << '\n';
  out.commit();
}

ColourMatrix::ColourMatrix(const Eigen::Matrix3d& matrix) : matrix_(matrix.cast<float>()), srgb_(kSteps + 1) {
  for (std::size_t k = 0; k < linear_.size(); ++k)
    linear_[k] = static_cast<float>(linearFromSrgb(static_cast<std::uint8_t>(k)));
  // For each step of linear light, the 8-bit sRGB level that is nearest in linear light.
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

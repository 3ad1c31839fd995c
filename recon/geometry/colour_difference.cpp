#include "recon/geometry/colour_difference.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace fathom {

double linearFromSrgb(double srgb) {
  constexpr double kKnee = 0.04045;
  return srgb <= kKnee ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
}

double luminanceOf(const Rgb& srgb) {
  const auto linear = [&](std::size_t c) { return linearFromSrgb(srgb[c] / 255.0); };
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
    return v > kKnee * kKnee * kKnee ? std::cbrt(v) : v / (3 * kKnee * kKnee) + 4.0 / 29;
  };
  const double x = f(t.x()), y = f(t.y()), z = f(t.z());
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

double ciede2000(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  constexpr double kDegree = std::numbers::pi / 180, kTurn = 2 * std::numbers::pi;
  constexpr double k25To7 = 6103515625.0;
  const auto squashed = [](double chroma) {
    const double c7 = std::pow(chroma, 7);
    return std::sqrt(c7 / (c7 + k25To7));
  };
  const double mean_c = 0.5 * (std::hypot(a.y(), a.z()) + std::hypot(b.y(), b.z()));
  const double g = 0.5 * (1 - squashed(mean_c));
  const double a1 = (1 + g) * a.y(), a2 = (1 + g) * b.y();
  const double c1 = std::hypot(a1, a.z()), c2 = std::hypot(a2, b.z());
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
  const double t = 1 - 0.17 * std::cos(h - 30 * kDegree) + 0.24 * std::cos(2 * h) +
                   0.32 * std::cos(3 * h + 6 * kDegree) - 0.20 * std::cos(4 * h - 63 * kDegree);
  const double turn = 30 * kDegree * std::exp(-std::pow((h / kDegree - 275) / 25, 2));
  const double off = (l - 50) * (l - 50);
  const double sl = 1 + 0.015 * off / std::sqrt(20 + off), sc = 1 + 0.045 * c, sh = 1 + 0.015 * c * t;
  const double rt = -std::sin(2 * turn) * 2 * squashed(c);
  const double x = dl / sl, y = dc / sc, z = dH / sh;
  return std::sqrt(std::max(0.0, x * x + y * y + z * z + rt * y * z));
}

}  // namespace fathom

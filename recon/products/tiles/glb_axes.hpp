#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>

namespace fathom::topside {

// nav (north, east, down) to glTF (east, up, south) and back.
[[nodiscard]] inline Eigen::Vector3d gltfFromNav(const Eigen::Vector3d& v) {
  return {v.y(), -v.z(), -v.x()};
}
[[nodiscard]] inline Eigen::Vector3d navFromGltf(const Eigen::Vector3d& v) {
  return {-v.z(), v.x(), -v.y()};
}
[[nodiscard]] inline Eigen::Vector3f gltfFromNav(const Eigen::Vector3f& v) {
  return {v.y(), -v.z(), -v.x()};
}
[[nodiscard]] inline Eigen::Vector3f navFromGltf(const Eigen::Vector3f& v) {
  return {-v.z(), v.x(), -v.y()};
}

// sRGB's transfer function (IEC 61966-2-1); glTF wants colours of vertices linear. 16 bits tell all 256
// values of sRGB apart.
[[nodiscard]] inline std::uint16_t linearFromSrgb(std::uint8_t value) {
  const double s = value / 255.0;
  const double linear = s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4);
  return static_cast<std::uint16_t>(std::lround(65535 * linear));
}
[[nodiscard]] inline std::uint8_t srgbFromLinear(std::uint16_t value) {
  const double linear = value / 65535.0;
  const double s = linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
  return static_cast<std::uint8_t>(std::clamp(std::lround(255 * s), 0L, 255L));
}

}  // namespace fathom::topside

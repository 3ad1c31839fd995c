#pragma once

#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

// All conversion factors between units. Internally angles are radians and times int64_t nanoseconds; other
// units occur only in files, devices and displays.
namespace fathom {

inline constexpr double kRadiansPerDegree = std::numbers::pi / 180;
inline constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
[[nodiscard]] constexpr double degreesToRadians(double degrees) noexcept {
  return degrees * std::numbers::pi / 180;
}
[[nodiscard]] constexpr double radiansToDegrees(double radians) noexcept {
  return radians * 180 / std::numbers::pi;
}

inline constexpr double kNanosecondsPerSecond = 1e9, kNanosecondsPerMillisecond = 1e6,
                        kMicrosecondsPerSecond = 1e6;
inline constexpr std::int64_t kMicrosecond_ns = 1'000, kMillisecond_ns = 1'000'000,
                              kSecond_ns = 1'000'000'000;

inline constexpr std::size_t kMebibyte = 1024 * 1024;
[[nodiscard]] constexpr double mebibytes(std::size_t bytes) noexcept {
  return static_cast<double>(bytes) / kMebibyte;
}

}  // namespace fathom

namespace fathom::rt {

[[nodiscard]] constexpr double seconds(std::int64_t ns) noexcept {
  return static_cast<double>(ns) / kNanosecondsPerSecond;
}
[[nodiscard]] constexpr double milliseconds(std::int64_t ns) noexcept {
  return static_cast<double>(ns) * 1e-6;
}
[[nodiscard]] inline std::int64_t nanoseconds(double s) noexcept {
  return std::llround(s * kNanosecondsPerSecond);
}

[[nodiscard]] inline double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace fathom::rt

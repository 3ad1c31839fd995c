#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>

namespace fathom::rt {

[[nodiscard]] constexpr double seconds(std::int64_t ns) noexcept {
  return static_cast<double>(ns) / 1e9;
}
[[nodiscard]] inline std::int64_t nanoseconds(double s) noexcept {
  return std::llround(s * 1e9);
}

[[nodiscard]] inline double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace fathom::rt

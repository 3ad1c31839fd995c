#pragma once

#include <numbers>

namespace fathom::sim {

// An angle given in degrees, in rad.
[[nodiscard]] constexpr double degrees(double value) {
  return value * std::numbers::pi / 180.0;
}

}  // namespace fathom::sim

#pragma once

#include <cstdio>
#include <string>

namespace fathom {

// A number with so many digits after the point.
[[nodiscard]] inline std::string decimals(double value, int places) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", places, value);
  return text;
}

}  // namespace fathom

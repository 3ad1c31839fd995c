#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

namespace fathom::io {

// Numbers as the table has them.
inline std::string decimals(double value, int places) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", places, value);
  return text;
}
inline std::string plural(std::uint64_t count, const std::string& thing) {
  return std::to_string(count) + " " + thing + (count == 1 ? "" : "s");
}

}  // namespace fathom::io

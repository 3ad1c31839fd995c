#pragma once

#include <cstdint>
#include <string>

#include "realtime/kernel/text.hpp"

namespace fathom::io {

// A count as the table has it.
inline std::string plural(std::uint64_t count, const std::string& thing) {
  return std::to_string(count) + " " + thing + (count == 1 ? "" : "s");
}

}  // namespace fathom::io

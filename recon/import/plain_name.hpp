#pragma once

#include <cctype>
#include <string>

namespace fathom::topside {

// The letters and digits of a name in a file, in lower case: "Dist_Coeffs 1" and "distCoeffs1" are the same.
[[nodiscard]] inline std::string plainName(const std::string& name) {
  std::string out;
  for (const char c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) != 0)
      out += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return out;
}

}  // namespace fathom::topside

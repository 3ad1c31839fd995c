#pragma once

#include <string>

namespace fathom::io {

// A double in TOML, the shortest decimal that reads back to the same bits.
[[nodiscard]] std::string tomlNumber(double value);
// A basic string with its quotes, every character that TOML would misread escaped.
[[nodiscard]] std::string tomlString(const std::string& text);

}  // namespace fathom::io

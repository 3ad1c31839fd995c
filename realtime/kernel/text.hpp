#pragma once

#include <string>

namespace fathom {

// What printf would write.
[[nodiscard, gnu::format(printf, 1, 2)]] std::string formatted(const char* format, ...);

// A number with so many digits after the point, for people; "-" for one that is not finite.
[[nodiscard]] std::string decimals(double value, int places);

// Text as HTML and XML take it, in an attribute too: & < > " escaped, control characters but for the white
// space dropped.
[[nodiscard]] std::string markupText(const std::string& text);

// Text as a field of a table with commas: quoted where it must be (RFC 4180).
[[nodiscard]] std::string tableField(const std::string& text);

}  // namespace fathom

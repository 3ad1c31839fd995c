#pragma once

#include <string>
#include <string_view>

namespace fathom {

// Text formatted as printf does.
[[nodiscard, gnu::format(printf, 1, 2)]] std::string formatted(const char* format, ...);

// A number with `places` digits after the decimal point; "-" if it is not finite.
[[nodiscard]] std::string decimals(double value, int places);

// Text escaped for HTML and XML, attributes included: & < > " are escaped, control characters other than
// white space are dropped.
[[nodiscard]] std::string markupText(const std::string& text);

// Text as a field of a CSV table: quoted where necessary (RFC 4180).
[[nodiscard]] std::string tableField(const std::string& text);

// Any bytes as text for one line of a terminal. Well-formed UTF-8 is kept; each byte that is not part of a
// well-formed character (Unicode 15, table 3-7), and each character that a terminal interprets (control
// characters, line ends, changes of writing direction) becomes '?'.
[[nodiscard]] std::string printableText(std::string_view text);

}  // namespace fathom

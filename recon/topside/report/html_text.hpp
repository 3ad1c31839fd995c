#pragma once

#include <string>

namespace fathom::topside {

// Pieces that the HTML reports share.

// A number with so many digits after the point; "-" for one that is not finite.
[[nodiscard]] std::string fixedDigits(double value, int digits);
// Everything of a page before its content: doctype, title, style, and the title as heading.
[[nodiscard]] std::string htmlHead(const std::string& title);
// One row of a table: the name, and the value to the right.
[[nodiscard]] std::string htmlRow(const std::string& name, const std::string& value);

}  // namespace fathom::topside

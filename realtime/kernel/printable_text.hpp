#pragma once

#include <string>
#include <string_view>

namespace fathom {

// Text that any bytes give, on one line of a terminal: UTF-8 as it is, each byte that is no part of a
// well-formed character '?' (Unicode 15, table 3-7), and so each character that a terminal or its reader
// would take for an order: control characters, line ends and changes of the direction of writing.
[[nodiscard]] std::string printableText(std::string_view text);

}  // namespace fathom

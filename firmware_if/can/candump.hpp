#pragma once

#include <string_view>

#include "firmware_if/can/line_words.hpp"

namespace fathom::io {

// Reads one line, without its line end, of can-utils' candump: the log form `(1502984866.421964) can0
// 09F112CC#FF725AFF7FFF7FFD` (-l, -L) or the screen form `(1502984866.421964)  can0  09F112CC   [8]  FF 72 5A
// ...`. The time in seconds may be missing; one in another form (a local date, -t A) is absent.
[[nodiscard]] CanLine parseCandumpLine(std::string_view line, CanFrame& frame) noexcept;

}  // namespace fathom::io

#pragma once

#include <string_view>

#include "firmware_if/can/line_words.hpp"

namespace fathom::io {

// Lines, without their ends, of what gateways between NMEA 2000 and a computer write. Each is recognised by
// how it begins.

// canboat's plain form: time (UTC), priority, parameter group, source, destination, size, bytes:
// `2024-02-17T05:15:49.768Z,2,127250,204,255,8,ff,72,5a,ff,7f,ff,7f,fd`, with `-` for the T and no Z by older
// versions. A size of up to 8 may be a frame or a whole message: both are given, and kFrame. A group beyond
// 18 bits is a gateway's own, kOther.
[[nodiscard]] bool isCanboatLine(std::string_view line) noexcept;
[[nodiscard]] CanLine parseCanboatLine(std::string_view line, CanFrame& frame, N2kPacket& packet) noexcept;

// Yacht Devices' RAW (YDWG-02 and others): time of day, R(eceived) or T(ransmitted), identifier, bytes:
// `17:33:21.107 R 19F51323 01 2F 30 70 00 2F 30 70`. It tells no date: the time is absent.
[[nodiscard]] bool isYachtDevicesLine(std::string_view line) noexcept;
[[nodiscard]] CanLine parseYachtDevicesLine(std::string_view line, CanFrame& frame) noexcept;

// Actisense's N2K ASCII (NGT-1, W2K-1): time of day, source with destination and priority, parameter group,
// all bytes of the message: `A173321.107 23FF7 1F513 012F3070002F30709F`. The time is absent, as it tells no
// date.
[[nodiscard]] bool isActisenseLine(std::string_view line) noexcept;
[[nodiscard]] CanLine parseActisenseLine(std::string_view line, N2kPacket& packet) noexcept;

}  // namespace fathom::io

#pragma once

#include <cstdint>
#include <span>

namespace fathom {

// CRC-32 of IEEE 802.3, as in zlib. `before`: the CRC of the bytes that precede these, to continue it.
[[nodiscard]] std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t before = 0) noexcept;

}  // namespace fathom

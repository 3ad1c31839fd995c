#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace fathom::telemetry {

// CRC-32 of IEEE 802.3 (reflected polynomial 0xEDB88320, initial value and final inversion all ones): the one
// of zlib and Ethernet; "123456789" gives 0xCBF43926.
[[nodiscard]] constexpr std::uint32_t crc32(std::span<const std::uint8_t> bytes) {
  constexpr auto kTable = [] {
    std::array<std::uint32_t, 256> table{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      std::uint32_t c = i;
      for (int k = 0; k < 8; ++k) c = (c & 1) != 0 ? c >> 1 ^ 0xEDB88320U : c >> 1;
      table[i] = c;
    }
    return table;
  }();
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const std::uint8_t byte : bytes) crc = crc >> 8 ^ kTable[(crc ^ byte) & 0xFFU];
  return ~crc;
}

}  // namespace fathom::telemetry

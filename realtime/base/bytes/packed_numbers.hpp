#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace fathom::rt {

// Compact form of eight whole numbers, little endian: a 32-bit word with the byte count of each number (4
// bits each, 0 to 8), then the bytes of the numbers, lowest first. For saved state that consists mostly of
// small numbers in wide fields.
using EightNumbers = std::array<std::uint64_t, 8>;
inline constexpr std::size_t kPackedHead = sizeof(std::uint32_t);
inline constexpr std::size_t kMostPacked = kPackedHead + sizeof(EightNumbers);

// Returns the bytes written; `to` must have room for kMostPacked.
inline std::size_t packNumbers(const EightNumbers& numbers, std::uint8_t* to) noexcept {
  std::uint32_t lengths = 0;
  std::size_t at = kPackedHead;
  for (unsigned i = 0; i < numbers.size(); ++i) {
    const auto bytes = static_cast<unsigned>(std::bit_width(numbers[i]) + 7) / 8;
    std::memcpy(to + at, &numbers[i], sizeof numbers[i]);
    at += bytes;
    lengths |= bytes << (4 * i);
  }
  std::memcpy(to, &lengths, sizeof lengths);
  return at;
}

// Size of the numbers after the word `lengths`; kMostPacked, which no valid word gives, if the word is
// invalid.
[[nodiscard]] constexpr std::size_t packedBytes(std::uint32_t lengths) noexcept {
  std::size_t bytes = 0;
  for (unsigned i = 0; i < 8; ++i) {
    const unsigned length = lengths >> (4 * i) & 0xF;
    if (length > sizeof(std::uint64_t)) return kMostPacked;
    bytes += length;
  }
  return bytes;
}

// `from`: packedBytes(lengths) bytes.
inline EightNumbers unpackNumbers(std::uint32_t lengths, const std::uint8_t* from) noexcept {
  EightNumbers numbers{};
  for (unsigned i = 0; i < numbers.size(); ++i) {
    const std::size_t bytes = lengths >> (4 * i) & 0xF;
    std::memcpy(&numbers[i], from, bytes);
    from += bytes;
  }
  return numbers;
}

}  // namespace fathom::rt

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

// Whole numbers of 1 to 8 bytes in the byte order of a file, a bus or a device, whatever the machine's own
// is. A number takes all bytes of the span that it is read from or written to. Signed numbers: cast what was
// read to the signed type of its size.
namespace fathom {

// Lowest byte first.
[[nodiscard]] constexpr std::uint64_t readLittleEndian(std::span<const std::uint8_t> bytes) noexcept {
  std::uint64_t value = 0;
  for (std::size_t i = bytes.size(); i-- > 0;) value = value << 8 | bytes[i];
  return value;
}
constexpr void writeLittleEndian(std::span<std::uint8_t> bytes, std::uint64_t value) noexcept {
  for (std::uint8_t& byte : bytes) {
    byte = static_cast<std::uint8_t>(value);
    value >>= 8;
  }
}

// Highest byte first.
[[nodiscard]] constexpr std::uint64_t readBigEndian(std::span<const std::uint8_t> bytes) noexcept {
  std::uint64_t value = 0;
  for (const std::uint8_t byte : bytes) value = value << 8 | byte;
  return value;
}
constexpr void writeBigEndian(std::span<std::uint8_t> bytes, std::uint64_t value) noexcept {
  for (std::size_t i = bytes.size(); i-- > 0;) {
    bytes[i] = static_cast<std::uint8_t>(value);
    value >>= 8;
  }
}

// The unsigned number that begins at byte `at`, as many bytes as its type has.
template <class Unsigned>
[[nodiscard]] constexpr Unsigned littleEndianAt(std::span<const std::uint8_t> bytes,
                                                std::size_t at) noexcept {
  return static_cast<Unsigned>(readLittleEndian(bytes.subspan(at, sizeof(Unsigned))));
}
template <class Unsigned>
[[nodiscard]] constexpr Unsigned bigEndianAt(std::span<const std::uint8_t> bytes, std::size_t at) noexcept {
  return static_cast<Unsigned>(readBigEndian(bytes.subspan(at, sizeof(Unsigned))));
}

}  // namespace fathom

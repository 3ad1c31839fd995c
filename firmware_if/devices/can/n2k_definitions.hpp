#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace fathom::io {

// Layout of the decoded parameter groups: where each field is in the bytes, little-endian, bit 0 the lowest
// of byte 0. Source: the layouts that canboat publishes (github.com/canboat/canboat, Apache-2.0); the tests
// compare with canboat's own decodes.
enum class N2kFieldKind : std::uint8_t { kUnsigned, kSigned, kFloat, kName };

struct N2kFieldSpec {
  const char* name;  // with its unit
  std::uint16_t bit;
  std::uint8_t bits;
  N2kFieldKind kind;
  // value = (raw + add) * multiply / divide: integers, so that decimal resolutions stay exact.
  double multiply = 1;
  double divide = 1;
  double add = 0;
  std::span<const char* const> names = {};  // for kName: what the codes from 0 on stand for
};

struct N2kPgnSpec {
  std::uint32_t pgn;
  bool fast_packet;
  const char* description;
  std::span<const N2kFieldSpec> fields;
};

// How many of the highest values of a field with so many bits are not numbers: "reserved", "out of range" and
// "not available" from a byte on; smaller fields have room for fewer.
[[nodiscard]] constexpr std::uint64_t reservedN2kValues(std::size_t bits) noexcept {
  return bits >= 8 ? 3 : bits >= 4 ? 2 : bits > 1 ? 1 : 0;
}

// nullptr for a parameter group that has no decoder.
[[nodiscard]] const N2kPgnSpec* findN2kPgn(std::uint32_t pgn) noexcept;
// All of them, in order of number.
[[nodiscard]] std::span<const N2kPgnSpec> n2kPgns() noexcept;

}  // namespace fathom::io

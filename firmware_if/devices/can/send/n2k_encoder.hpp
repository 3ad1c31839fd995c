#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "firmware_if/devices/can/can_frame.hpp"

namespace fathom::io {

struct N2kValue {
  std::string_view name;  // as in n2k_definitions.cpp
  double value = 0;       // in the unit that the name says; of a named code, the code
};

// Encodes the payload of a parameter group that n2k_definitions.cpp defines into all of `out`: fields that
// are not given, not finite or out of the field's range are "not available", reserved bits are ones. The
// inverse of decodeN2kPayload. False for a group or a field that has no definition, and for a field behind
// the end of `out`.
[[nodiscard]] bool encodeN2kPayload(std::uint32_t pgn, std::span<const N2kValue> values,
                                    std::span<std::uint8_t> out) noexcept;

// The frames of a fast packet, at most 32; returns how many. `payload`: at most 223 bytes.
inline constexpr std::size_t kMaxFastPacketFrames = 32;
[[nodiscard]] std::size_t splitFastPacket(const N2kId& id, unsigned sequence,
                                          std::span<const std::uint8_t> payload,
                                          std::array<CanFrame, kMaxFastPacketFrames>& out) noexcept;

}  // namespace fathom::io

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace fathom::telemetry {

// Small integers through Draco's sequential point-cloud coder (difference prediction, rANS): `count` points
// of `components` values, interleaved, each 0 to 32767 and the least of all 0. The 26 bytes that are the same
// in every such stream or follow from the caller's counts are not sent, so that hostile bytes cannot choose
// the memory of decoding. Draco allocates; best-effort tier only.
inline constexpr std::size_t kMaxDracoPoints = 289;
inline constexpr int kMaxDracoComponents = 4;

// Returns the size, 0 if the values are not as above or `out` is too small.
[[nodiscard]] std::size_t encodeValues(std::span<const std::int16_t> values, int components,
                                       std::span<std::uint8_t> out);
// Fills all of `values`; false if the bytes are not such a stream.
[[nodiscard]] bool decodeValues(std::span<const std::uint8_t> bytes, int components,
                                std::span<std::int16_t> values);

}  // namespace fathom::telemetry

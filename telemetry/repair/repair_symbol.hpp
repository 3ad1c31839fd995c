#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "realtime/base/bytes/crc32.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// Repair frames: systematic Reed-Solomon over GF(2^8) with a Cauchy matrix (Bloemer et al. 1995, "An
// XOR-based erasure-resilient coding scheme"), so that any k of a group's k + r frames recover all k.
//
// A group is up to kMaxGroup frames with consecutive sequence numbers. Member j counts as a symbol: u8 length
// of its payload + 1, the payload, zeros up to the longest member; a member that is no map packet counts as
// all zeros (status and track are out of date by the time they could be repaired). Row r of the matrix has 1
// / ((kMaxGroup + r) xor j) in column j.
//
// Payload of a repair frame, whose header carries the sequence number of member 0: u8 k - 1, u8 r, the row's
// symbol.
inline constexpr int kMaxGroup = 64;
inline constexpr int kMaxRepairRows = 256 - kMaxGroup;
inline constexpr std::size_t kRepairHeadBytes = 2;
inline constexpr std::size_t kMaxSymbolBytes = kMaxFrameBytes - kFrameOverhead - kRepairHeadBytes;
// A map packet must be this much shorter than a frame's payload to be repairable by frames of that size.
inline constexpr std::size_t kRepairMargin = kRepairHeadBytes + 1;

// Digest of a group, from its symbols one after the other: begins with 0, ends with groupDigest(). All repair
// frames of a group carry it in their tags (DecodedFrame::group), so that frames of two groups are never
// solved as one, and what was repaired is what was sent.
[[nodiscard]] inline std::uint32_t digestSymbol(std::uint32_t before, std::span<const std::uint8_t> symbol) {
  return crc32(symbol, before);
}
[[nodiscard]] constexpr std::uint8_t groupDigest(std::uint32_t digest) {
  return static_cast<std::uint8_t>(digest ^ digest >> 8 ^ digest >> 16 ^ digest >> 24);
}

// Writes a member's symbol, padded to symbol.size(); false if the payload does not fit.
[[nodiscard]] inline bool makeSymbol(std::span<const std::uint8_t> map_payload, bool is_map,
                                     std::span<std::uint8_t> symbol) {
  std::fill(symbol.begin(), symbol.end(), std::uint8_t{0});
  if (!is_map) return true;
  if (map_payload.size() + 1 > symbol.size() || map_payload.size() >= 255) return false;
  symbol[0] = static_cast<std::uint8_t>(map_payload.size() + 1);
  std::copy(map_payload.begin(), map_payload.end(), symbol.begin() + 1);
  return true;
}

}  // namespace fathom::telemetry

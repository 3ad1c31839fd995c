#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// Repair frames: systematic Reed-Solomon over GF(2^8) with a Cauchy matrix (Bloemer et al. 1995, "An
// XOR-based erasure-resilient coding scheme"), so that any k of a group's k + r frames give back all k.
//
// A group is up to kMaxGroup frames with consecutive sequence numbers. Member j counts as a symbol: u8 length
// of its payload + 1, the payload, zeros up to the longest member; a member that is no map packet counts as
// all zeros (status and track are out of date by the time they could be repaired). Row r of the matrix has
// 1 / ((kMaxGroup + r) xor j) in column j.
//
// Payload of a repair frame, whose header carries the sequence number of member 0: u8 k - 1, u8 r, the row's
// symbol.
inline constexpr int kMaxGroup = 64;
inline constexpr int kMaxRepairRows = 256 - kMaxGroup;
inline constexpr std::size_t kRepairHeadBytes = 2;
inline constexpr std::size_t kMaxSymbolBytes = kMaxFrameBytes - kFrameOverhead - kRepairHeadBytes;
// A map packet must be this much shorter than a frame's payload to be repairable by frames of that size.
inline constexpr std::size_t kRepairMargin = kRepairHeadBytes + 1;

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

#pragma once

#include <vector>

#include "realtime/base/units.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

using Bytes = std::vector<std::uint8_t>;
inline constexpr LinkIdentity kOurs{7, 1234};
inline constexpr std::int64_t kStart_ns = 1'790'000'000 * kSecond_ns;

inline LinkKey keyOf(std::uint8_t first) {
  std::array<std::uint8_t, LinkKey::kBytes> secret{};
  secret[0] = first;
  return LinkKey(secret);
}

// The link frame with this payload.
inline Bytes frameWith(const FrameHeader& header, std::span<const std::uint8_t> payload,
                       const FrameTag& tag = {}) {
  Bytes out(kMaxFrameBytes);
  out.resize(encodeFrame(header, payload, out, tag));
  return out;
}

// A frame whose payload counts up from its sequence number.
inline Bytes countingFrame(std::uint16_t sequence, std::size_t payload_bytes = 20,
                           const LinkIdentity& identity = kOurs) {
  Bytes payload(payload_bytes);
  for (std::size_t i = 0; i < payload_bytes; ++i) payload[i] = static_cast<std::uint8_t>(sequence + i);
  return frameWith({identity, sequence, MessageType::kTrack}, payload);
}

}  // namespace fathom::telemetry

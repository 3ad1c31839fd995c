#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "telemetry/wire/link_key.hpp"

namespace fathom::telemetry {

// The 32 bits that end a frame: SipHash-2-4 (Aumasson & Bernstein 2012, by libsodium) of what precedes them,
// cut to four bytes. With the key that ship and vehicle share they prove who made the frame, that it is
// undamaged, and, through the lap, when in the dive it was sent: one forged frame in 2^32 passes. Without a
// key they are a checksum as good as CRC-32, and the lap does not count.
class FrameTag {
 public:
  FrameTag() = default;
  explicit FrameTag(const std::optional<LinkKey>& key);

  [[nodiscard]] bool keyed() const { return keyed_; }
  // `lap`: the bits of the frame's version that the frame leaves out. At most kMaxFrameBytes bytes.
  [[nodiscard]] std::uint32_t of(std::span<const std::uint8_t> bytes, std::uint16_t lap) const;

 private:
  std::array<std::uint8_t, 16> secret_{};  // derived from the key, for this purpose alone
  bool keyed_ = false;
};

}  // namespace fathom::telemetry

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace fathom::io {

// A classic CAN data frame with a 29-bit identifier, as NMEA 2000 uses.
struct CanFrame {
  std::optional<std::int64_t> utc_ns;  // of reception; absent where the capture has none
  std::uint32_t id = 0;                // 29 bits
  std::uint8_t size = 0;               // 0 to 8
  std::array<std::uint8_t, 8> data{};

  [[nodiscard]] std::span<const std::uint8_t> bytes() const { return {data.data(), size}; }
};

// What the identifier says (SAE J1939-21, section 5.2).
struct N2kId {
  std::uint8_t priority = 0;       // 0 is the highest
  std::uint32_t pgn = 0;           // parameter group number
  std::uint8_t source = 0;         // address
  std::uint8_t destination = 255;  // address; 255 is everyone
};

constexpr std::uint32_t kFirstBroadcastFormat = 240;  // from here on the specific field is part of the number

[[nodiscard]] constexpr N2kId parseN2kId(std::uint32_t id) {
  const std::uint32_t format = (id >> 16) & 0xFF;
  const std::uint32_t specific = (id >> 8) & 0xFF;
  N2kId out;
  out.priority = static_cast<std::uint8_t>((id >> 26) & 7);
  out.source = static_cast<std::uint8_t>(id & 0xFF);
  out.pgn = (id >> 8) & 0x3FF00;
  if (format < kFirstBroadcastFormat) {
    out.destination = static_cast<std::uint8_t>(specific);
  } else {
    out.pgn |= specific;
  }
  return out;
}

// The identifier that says so.
[[nodiscard]] constexpr std::uint32_t makeN2kId(const N2kId& id) noexcept {
  const std::uint32_t destination = ((id.pgn >> 8) & 0xFF) < kFirstBroadcastFormat ? id.destination : 0U;
  return (static_cast<std::uint32_t>(id.priority) << 26) | ((id.pgn | destination) << 8) | id.source;
}

// A whole message, as gateways write it that put fast packets together.
struct N2kPacket {
  static constexpr std::size_t kMaxBytes = 223;

  std::optional<std::int64_t> utc_ns;  // as of CanFrame
  N2kId id;
  std::uint8_t size = 0;
  std::array<std::uint8_t, kMaxBytes> data{};

  [[nodiscard]] std::span<const std::uint8_t> bytes() const { return {data.data(), size}; }
};

}  // namespace fathom::io

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "firmware_if/devices/can/can_frame.hpp"
#include "firmware_if/devices/can/fast_packet.hpp"

namespace fathom::io {

struct N2kField {
  const char* name = "";       // with its unit; static storage
  const char* text = nullptr;  // for a code that has a name ("magnetic"), else nullptr; static storage
  double value = 0;
};

// A decoded message: only the fields that have a value. NMEA 2000 keeps the highest values of a field for
// "not available", "out of range" and "reserved"; none of them is ever given as a number.
struct N2kMessage {
  static constexpr std::size_t kMaxFields = 12;

  std::optional<std::int64_t> utc_ns;  // of the frame that completed it
  N2kId id;
  std::size_t field_count = 0;
  std::array<N2kField, kMaxFields> fields{};

  [[nodiscard]] std::span<const N2kField> present() const { return {fields.data(), field_count}; }
  [[nodiscard]] std::optional<double> number(std::string_view name) const noexcept;
};

// Reads the payload of one whole message into `out.fields`; fields that it is too short for are absent. False
// when the PGN has no decoder.
[[nodiscard]] bool decodeN2kPayload(std::uint32_t pgn, std::span<const std::uint8_t> payload,
                                    N2kMessage& out) noexcept;

// Frames in, messages out. No input or output of its own; allocates only at construction.
class N2kDecoder {
 public:
  struct Counts {
    std::uint64_t messages = 0;         // given out
    std::uint64_t without_decoder = 0;  // frames and packets of other PGNs
  };

  N2kDecoder() = default;
  explicit N2kDecoder(const FastPacketAssembler::Config& config) : fast_packets_(config) {}

  // The message that `frame` or `packet` is or completes, valid until the next call; nullptr: none.
  [[nodiscard]] const N2kMessage* add(const CanFrame& frame) noexcept;
  [[nodiscard]] const N2kMessage* add(const N2kPacket& packet) noexcept;
  void finish() noexcept { fast_packets_.finish(); }

  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }
  [[nodiscard]] const FastPacketAssembler::Counts& fastPacketCounts() const noexcept {
    return fast_packets_.counts();
  }

 private:
  const N2kMessage* decode(const N2kId& id, std::span<const std::uint8_t> payload,
                           std::optional<std::int64_t> utc_ns) noexcept;

  FastPacketAssembler fast_packets_;
  N2kMessage message_;
  Counts counts_;
};

}  // namespace fathom::io

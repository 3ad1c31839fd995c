#include "firmware_if/devices/can/send/n2k_encoder.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "firmware_if/devices/can/fast_packet.hpp"
#include "firmware_if/devices/can/n2k_definitions.hpp"

namespace fathom::io {
namespace {

void insertBits(std::span<std::uint8_t> payload, std::size_t begin, std::size_t bits, std::uint64_t raw) {
  for (std::size_t i = 0; i < bits; ++i) {
    const auto mask = static_cast<std::uint8_t>(1U << ((begin + i) % 8));
    std::uint8_t& byte = payload[(begin + i) / 8];
    byte = static_cast<std::uint8_t>((raw >> i & 1) != 0 ? byte | mask : byte & ~mask);
  }
}

std::uint64_t rawN2kValue(const N2kFieldSpec& field, double value) {
  const bool is_signed = field.kind == N2kFieldKind::kSigned;
  const unsigned value_bits = is_signed ? field.bits - 1U : field.bits;
  const std::uint64_t ones = value_bits == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << value_bits) - 1;
  if (field.kind == N2kFieldKind::kFloat) return std::bit_cast<std::uint32_t>(static_cast<float>(value));
  if (field.kind == N2kFieldKind::kName)
    return value >= 0 && value < static_cast<double>(field.names.size()) ? static_cast<std::uint64_t>(value)
                                                                         : ones;
  const double scaled = std::round(value * field.divide / field.multiply - field.add);
  // As doubles: for the widest fields the bound is rounded, and by far beyond any number sent.
  const double largest = static_cast<double>(ones - reservedN2kValues(field.bits));
  const double smallest = is_signed ? -static_cast<double>(ones) : 0;
  if (!(scaled >= smallest && scaled <= largest)) return ones;
  return static_cast<std::uint64_t>(static_cast<std::int64_t>(scaled));
}

}  // namespace

bool encodeN2kPayload(std::uint32_t pgn, std::span<const N2kValue> values,
                      std::span<std::uint8_t> out) noexcept {
  const N2kPgnSpec* spec = findN2kPgn(pgn);
  if (spec == nullptr) return false;
  std::ranges::fill(out, std::uint8_t{0xFF});
  for (const N2kFieldSpec& field : spec->fields) {
    // The highest positive value of a signed field has its sign bit clear.
    if (field.kind == N2kFieldKind::kSigned && field.bit + std::size_t{field.bits} <= out.size() * 8)
      insertBits(out, field.bit + field.bits - 1U, 1, 0);
  }
  for (const N2kValue& given : values) {
    const auto field =
        std::ranges::find_if(spec->fields, [&](const auto& f) { return given.name == f.name; });
    if (field == spec->fields.end() || field->bit + std::size_t{field->bits} > out.size() * 8) return false;
    if (std::isfinite(given.value))
      insertBits(out, field->bit, field->bits, rawN2kValue(*field, given.value));
  }
  return true;
}

std::size_t splitFastPacket(const N2kId& id, unsigned sequence, std::span<const std::uint8_t> payload,
                            std::array<CanFrame, kMaxFastPacketFrames>& out) noexcept {
  if (payload.size() > FastPacketAssembler::kMaxBytes) return 0;
  std::size_t count = 0;
  for (std::size_t at = 0; at < payload.size() || count == 0;) {
    CanFrame& frame = out[count];
    frame = {};
    frame.id = makeN2kId(id);
    frame.size = 8;
    frame.data.fill(0xFF);
    std::size_t begin = 0;
    frame.data[begin++] = static_cast<std::uint8_t>((sequence & 7U) << 5 | count);
    if (count == 0) frame.data[begin++] = static_cast<std::uint8_t>(payload.size());
    const std::size_t taken = std::min(frame.data.size() - begin, payload.size() - at);
    std::copy_n(payload.begin() + static_cast<std::ptrdiff_t>(at), taken,
                frame.data.begin() + static_cast<std::ptrdiff_t>(begin));
    at += taken;
    ++count;
  }
  return count;
}

}  // namespace fathom::io

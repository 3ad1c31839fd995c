#include "firmware_if/devices/can/n2k_decoder.hpp"

#include <bit>
#include <cassert>
#include <cmath>

#include "firmware_if/devices/can/n2k_definitions.hpp"

namespace fathom::io {
namespace {

// The `bits` (1 to 64) from bit `begin` on; the caller checks that the payload has them.
std::uint64_t extractBits(std::span<const std::uint8_t> payload, std::size_t begin, std::size_t bits) {
  std::uint64_t out = 0;
  for (std::size_t taken = 0; taken < bits;) {
    const std::size_t shift = (begin + taken) % 8;
    const std::uint64_t part = static_cast<std::uint64_t>(payload[(begin + taken) / 8]) >> shift;
    out |= part << taken;
    taken += 8 - shift;
  }
  return bits == 64 ? out : out & ((std::uint64_t{1} << bits) - 1);
}

std::optional<N2kField> readN2kField(const N2kFieldSpec& spec, std::span<const std::uint8_t> payload) {
  if (spec.bit + std::size_t{spec.bits} > payload.size() * 8) return std::nullopt;
  assert(spec.bits > 0);
  const std::uint64_t raw = extractBits(payload, spec.bit, spec.bits);
  const std::uint64_t sign_bit = std::uint64_t{1} << (spec.bits - 1);
  const std::uint64_t largest = spec.kind == N2kFieldKind::kSigned ? sign_bit - 1 : sign_bit | (sign_bit - 1);
  N2kField out{spec.name, nullptr, 0};
  switch (spec.kind) {
    case N2kFieldKind::kName:
      if (raw >= spec.names.size()) return std::nullopt;
      out.text = spec.names[raw];
      out.value = static_cast<double>(raw);
      return out;
    case N2kFieldKind::kFloat:
      out.value = std::bit_cast<float>(static_cast<std::uint32_t>(raw));
      if (!std::isfinite(out.value)) return std::nullopt;
      return out;
    case N2kFieldKind::kUnsigned:
      if (raw > largest - reservedN2kValues(spec.bits)) return std::nullopt;
      out.value = static_cast<double>(raw);
      break;
    case N2kFieldKind::kSigned: {
      const bool negative = (raw & sign_bit) != 0;
      if (!negative && raw > largest - reservedN2kValues(spec.bits)) return std::nullopt;
      // Ones above the sign bit make it a negative 64-bit number.
      out.value =
          static_cast<double>(static_cast<std::int64_t>(negative ? raw | ~(sign_bit | (sign_bit - 1)) : raw));
      break;
    }
  }
  out.value = (out.value + spec.add) * spec.multiply / spec.divide;
  return out;
}

}  // namespace

std::optional<double> N2kMessage::number(std::string_view name) const noexcept {
  for (const N2kField& field : present()) {
    if (name == field.name) return field.value;
  }
  return std::nullopt;
}

bool decodeN2kPayload(std::uint32_t pgn, std::span<const std::uint8_t> payload, N2kMessage& out) noexcept {
  out.field_count = 0;
  const N2kPgnSpec* spec = findN2kPgn(pgn);
  if (spec == nullptr) return false;
  for (const N2kFieldSpec& field : spec->fields) {
    if (out.field_count == N2kMessage::kMaxFields) break;
    if (const auto value = readN2kField(field, payload)) out.fields[out.field_count++] = *value;
  }
  return true;
}

const N2kMessage* N2kDecoder::add(const CanFrame& frame) noexcept {
  const N2kId id = parseN2kId(frame.id);
  const N2kPgnSpec* spec = findN2kPgn(id.pgn);
  std::span<const std::uint8_t> payload = frame.bytes();
  if (spec != nullptr && spec->fast_packet) {
    payload = fast_packets_.add(id, frame);
    if (payload.empty()) return nullptr;
  }
  return decode(id, payload, frame.utc_ns);
}

const N2kMessage* N2kDecoder::add(const N2kPacket& packet) noexcept {
  return decode(packet.id, packet.bytes(), packet.utc_ns);
}

const N2kMessage* N2kDecoder::decode(const N2kId& id, std::span<const std::uint8_t> payload,
                                     std::optional<std::int64_t> utc_ns) noexcept {
  if (!decodeN2kPayload(id.pgn, payload, message_)) {
    ++counts_.without_decoder;
    return nullptr;
  }
  message_.utc_ns = utc_ns;
  message_.id = id;
  ++counts_.messages;
  return &message_;
}

}  // namespace fathom::io

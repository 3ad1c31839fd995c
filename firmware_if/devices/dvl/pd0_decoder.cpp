#include "firmware_if/devices/dvl/pd0_decoder.hpp"

#include <algorithm>

#include "realtime/base/bytes/byte_order.hpp"

namespace fathom::io {
namespace {

constexpr std::uint8_t kPd0HeaderId = 0x7F;  // stands twice
constexpr std::size_t kPd0BlockIdBytes = 2;
constexpr std::size_t kPd0LargestLength = 65535;  // the length field has 16 bits

// Header, length without the checksum, and the table of the blocks' offsets.
EnsembleStream::Header readPd0Header(std::span<const std::uint8_t> bytes, std::size_t longest) noexcept {
  using State = EnsembleStream::Header::State;
  if (bytes.size() >= 2 && bytes[1] != kPd0HeaderId) return {};
  if (bytes.size() < kPd0HeaderBytes) return {State::kIncomplete};
  const std::size_t length = littleEndianAt<std::uint16_t>(bytes, 2), types = bytes[5];
  const std::size_t size = length + EnsembleStream::kChecksumBytes;
  const std::size_t table_end = kPd0HeaderBytes + 2 * types;
  if (types == 0 || length < table_end + kPd0BlockIdBytes || size > longest) return {};
  if (bytes.size() < table_end) return {State::kIncomplete, size};
  for (std::size_t i = 0; i < types; ++i) {
    const std::size_t offset = littleEndianAt<std::uint16_t>(bytes, kPd0HeaderBytes + 2 * i);
    if (offset < table_end || offset + kPd0BlockIdBytes > length) return {};
  }
  return {State::kPossible, size};
}

}  // namespace

Pd0Decoder::Pd0Decoder(const Config& config)
    : stream_(kPd0HeaderId,
              std::clamp(config.max_ensemble_bytes, std::size_t{64},
                         kPd0LargestLength + EnsembleStream::kChecksumBytes),
              readPd0Header) {}

const Pd0Ensemble* Pd0Decoder::next() noexcept {
  for (auto found = stream_.next(); !found.empty(); found = stream_.next()) {
    if (!readPd0Ensemble(found.first(found.size() - EnsembleStream::kChecksumBytes), ensemble_)) {
      ++stream_.counts().malformed;
      continue;
    }
    ++stream_.counts().good;
    raw_ = found;
    return &ensemble_;
  }
  return nullptr;
}

}  // namespace fathom::io

#include "telemetry/wire/frame_tag.hpp"

#include <sodium.h>

#include <algorithm>
#include <cassert>

#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

FrameTag::FrameTag(const std::optional<LinkKey>& key) : keyed_(key.has_value()) {
  static_assert(std::tuple_size_v<decltype(secret_)> == crypto_shorthash_KEYBYTES);
  if (key) key->derive("Fathom uplink 4", secret_);
}

std::uint32_t FrameTag::of(std::span<const std::uint8_t> bytes, std::uint16_t lap) const {
  assert(bytes.size() <= kMaxFrameBytes);
  std::array<std::uint8_t, kMaxFrameBytes + 2> text;
  std::copy(bytes.begin(), bytes.end(), text.begin());
  std::size_t size = bytes.size();
  if (keyed_) {
    text[size++] = static_cast<std::uint8_t>(lap >> 8);
    text[size++] = static_cast<std::uint8_t>(lap);
  }
  std::array<std::uint8_t, crypto_shorthash_BYTES> hash;
  crypto_shorthash(hash.data(), text.data(), size, secret_.data());
  std::uint32_t tag = 0;
  for (std::size_t i = 0; i < sizeof tag; ++i) tag = tag << 8 | hash[i];
  return tag;
}

}  // namespace fathom::telemetry

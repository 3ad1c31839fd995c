#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

namespace fathom::telemetry {

// Arithmetic coding of yes/no decisions (Martin, 1979: range coder with carry) for packets of tens of bytes:
// nothing is written before the first decision, and the end takes as few bytes as leave the decoder no
// choice, which reads zeros after the last byte. Whole numbers only: every machine reads the same.
//
// A probability is that of `true`, in 1/65536, from kMinChance to kMaxChance.
using Chance = std::uint32_t;
inline constexpr unsigned kChanceBits = 16;
inline constexpr Chance kHalf = 1U << (kChanceBits - 1);
inline constexpr Chance kMinChance = 32;  // a surprise costs 11 bits at most
inline constexpr Chance kMaxChance = (1U << kChanceBits) - kMinChance;
inline constexpr std::uint32_t kRangeFloor = 1U << 24;  // below this the range takes in the next byte

class RangeEncoder {
 public:
  static constexpr bool kEncodes = true;
  explicit RangeEncoder(std::span<std::uint8_t> out) : out_(out) {}

  bool code(bool value, Chance chance) {
    const auto part = static_cast<std::uint32_t>(std::uint64_t{range_} * chance >> kChanceBits);
    if (value) {
      range_ = part;
    } else {
      low_ += part;
      range_ -= part;
      if (low_ < part) carry();
    }
    while (range_ < kRangeFloor) {
      put(static_cast<std::uint8_t>(low_ >> 24));
      low_ <<= 8;
      range_ <<= 8;
    }
    return value;
  }
  // Writes the end and returns the whole size; ok() says whether it fitted.
  std::size_t finish() {
    // The shortest number in [low, low + range), once zeros follow it.
    for (unsigned kept = 0; kept <= 4; ++kept) {
      const std::uint64_t below = kept == 4 ? 0 : (std::uint64_t{1} << (32 - 8 * kept)) - 1;
      const std::uint64_t value = (std::uint64_t{low_} + below) & ~below;
      if (value - low_ >= range_) continue;
      if (value >> 32 != 0) carry();
      for (unsigned k = 0; k < kept; ++k) put(static_cast<std::uint8_t>(value >> (24 - 8 * k)));
      break;
    }
    while (size_ > 0 && size_ <= out_.size() && out_[size_ - 1] == 0) --size_;
    return size_;
  }
  [[nodiscard]] bool ok() const { return size_ <= out_.size(); }
  [[nodiscard]] std::size_t size() const { return size_; }

 private:
  void put(std::uint8_t byte) {
    if (size_ < out_.size()) out_[size_] = byte;
    ++size_;
  }
  void carry() {
    for (std::size_t k = std::min(size_, out_.size()); k-- > 0;)
      if (++out_[k] != 0) break;
  }
  std::span<std::uint8_t> out_;
  std::size_t size_ = 0;
  std::uint32_t low_ = 0;
  std::uint32_t range_ = 0xFFFFFFFFU;
};

class RangeDecoder {
 public:
  static constexpr bool kEncodes = false;
  explicit RangeDecoder(std::span<const std::uint8_t> in) : in_(in) {
    for (int k = 0; k < 4; ++k) code_ = code_ << 8 | next();
  }
  bool code(bool /*unused: the encoder's value*/, Chance chance) {
    const auto part = static_cast<std::uint32_t>(std::uint64_t{range_} * chance >> kChanceBits);
    const bool value = code_ < part;
    if (value) {
      range_ = part;
    } else {
      code_ -= part;
      range_ -= part;
    }
    while (range_ < kRangeFloor) {
      code_ = code_ << 8 | next();
      range_ <<= 8;
    }
    return value;
  }
  // Bytes read beyond the end of the input: more than 4 means that the bytes were not whole.
  [[nodiscard]] std::size_t overrun() const { return at_ > in_.size() ? at_ - in_.size() : 0; }

 private:
  std::uint8_t next() {
    const std::uint8_t byte = at_ < in_.size() ? in_[at_] : std::uint8_t{0};
    ++at_;
    return byte;
  }
  std::span<const std::uint8_t> in_;
  std::size_t at_ = 0;
  std::uint32_t code_ = 0;
  std::uint32_t range_ = 0xFFFFFFFFU;
};

// An adaptive chance: it moves towards the decisions coded, faster while they are few.
class AdaptiveBit {
 public:
  explicit constexpr AdaptiveBit(Chance chance = kHalf, unsigned seen = 1)
      : chance_(static_cast<std::uint16_t>(chance)), seen_(static_cast<std::uint8_t>(seen)) {}
  [[nodiscard]] Chance chance() const { return chance_; }
  void learn(bool value) {
    const int target = value ? static_cast<int>(kMaxChance) : static_cast<int>(kMinChance);
    chance_ = static_cast<std::uint16_t>(chance_ + (target - chance_) / (seen_ + 2));
    if (seen_ < kSlowest) ++seen_;
  }

 private:
  static constexpr std::uint8_t kSlowest = 60;  // the memory is this many decisions long
  std::uint16_t chance_;
  std::uint8_t seen_;
};

// One decision by an adaptive chance, through either coder.
template <class Coder>
bool codeBit(Coder& coder, AdaptiveBit& bit, bool value) {
  value = coder.code(value, bit.chance());
  bit.learn(value);
  return value;
}
// `bits` even decisions, most significant first.
template <class Coder>
std::uint32_t codeRaw(Coder& coder, std::uint32_t value, unsigned bits) {
  std::uint32_t out = 0;
  for (unsigned k = bits; k-- > 0;) out = out << 1 | (coder.code((value >> k & 1U) != 0, kHalf) ? 1U : 0U);
  return out;
}

}  // namespace fathom::telemetry

#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

namespace fathom::telemetry {

// One number of a message, with its bounds and its resolution. The number of bits follows from them. Absent
// (NaN, where allowed) has the code after the last value.
struct Field {
  double min;
  double max;
  double resolution;
  bool may_be_absent = false;

  [[nodiscard]] constexpr std::uint64_t lastCode() const {
    // Rounded: std::lround is no constant expression. NOLINTNEXTLINE(bugprone-incorrect-roundings)
    return static_cast<std::uint64_t>((max - min) / resolution + 0.5);
  }
  [[nodiscard]] constexpr unsigned bits() const {
    std::uint64_t largest = lastCode() + (may_be_absent ? 1 : 0);
    unsigned n = 0;
    for (; largest > 0; largest >>= 1) ++n;
    return n;
  }
  // Whether `value` is inside the bounds (or absent where allowed): encoding it loses no more than resolution
  // / 2.
  [[nodiscard]] bool valid(double value) const {
    return std::isnan(value) ? may_be_absent : value >= min && value <= max;
  }
  // Nearest code; values outside saturate at the bounds, NaN becomes absent (or min where absent is not
  // allowed).
  [[nodiscard]] std::uint64_t encode(double value) const;
  // NaN for absent and for a code that no value has.
  [[nodiscard]] double decode(std::uint64_t code) const;
};

// A number over several decades: codes are spaced evenly in its logarithm. Code 0 is zero, the last code is
// `max`, or absent where allowed (then the one before is `max`).
struct LogField {
  double min;  // of code 1
  double max;
  unsigned width;  // [bit]
  bool may_be_absent = false;

  [[nodiscard]] constexpr unsigned bits() const { return width; }
  [[nodiscard]] constexpr std::uint64_t lastCode() const {
    return (std::uint64_t{1} << width) - (may_be_absent ? 2 : 1);
  }
  // Nearest code in the logarithm; below min / 2 zero, above max max, NaN absent (or zero where absent is not
  // allowed).
  [[nodiscard]] std::uint64_t encode(double value) const;
  [[nodiscard]] double decode(std::uint64_t code) const;
  // Greatest relative error of a value from min to max.
  [[nodiscard]] double relativeError() const {
    return std::pow(max / min, 0.5 / static_cast<double>(lastCode() - 1)) - 1;
  }
};

// Writes bits, most significant first, into a caller's buffer. Writing past the end sets ok() to false and
// writes nothing more.
class BitWriter {
 public:
  explicit BitWriter(std::span<std::uint8_t> out) : out_(out) {}
  void put(std::uint64_t value, unsigned bits);  // bits <= 64
  void put(const Field& field, double value) { put(field.encode(value), field.bits()); }
  void put(const LogField& field, double value) { put(field.encode(value), field.bits()); }
  void putSigned(std::int64_t value, unsigned bits) { put(static_cast<std::uint64_t>(value), bits); }
  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] std::size_t bits() const { return bit_; }
  [[nodiscard]] std::size_t bytes() const { return (bit_ + 7) / 8; }
  [[nodiscard]] std::size_t bitsLeft() const { return out_.size() * 8 - bit_; }

 private:
  std::span<std::uint8_t> out_;
  std::size_t bit_ = 0;
  bool ok_ = true;
};

// Reads what BitWriter wrote. Reading past the end, or a code that the field does not have, sets ok() to
// false.
class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> in) : in_(in) {}
  [[nodiscard]] std::uint64_t get(unsigned bits);
  [[nodiscard]] std::int64_t getSigned(unsigned bits);  // two's complement
  [[nodiscard]] double get(const Field& field);
  [[nodiscard]] double get(const LogField& field) { return field.decode(get(field.bits())); }
  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] std::size_t bytes() const { return (bit_ + 7) / 8; }
  [[nodiscard]] std::size_t bitsLeft() const { return in_.size() * 8 - bit_; }
  // Whether everything was read and only zero bits fill the last byte.
  [[nodiscard]] bool finished();

 private:
  std::span<const std::uint8_t> in_;
  std::size_t bit_ = 0;
  bool ok_ = true;
};

// Mixes a field's bounds into a schema hash (FNV-1a, 32 bit).
[[nodiscard]] constexpr std::uint32_t hashField(std::uint32_t hash, const Field& field) {
  const auto mix = [&](std::uint64_t word) {
    for (int i = 0; i < 8; ++i, word >>= 8) hash = (hash ^ static_cast<std::uint8_t>(word)) * 16777619U;
  };
  // Micro-units: exact for every bound in use.
  mix(static_cast<std::uint64_t>(static_cast<std::int64_t>(field.min * 1e6)));
  mix(field.lastCode());
  mix(static_cast<std::uint64_t>(field.resolution * 1e9));
  mix(field.may_be_absent ? 1 : 0);
  return hash;
}

[[nodiscard]] constexpr std::uint32_t hashField(std::uint32_t hash, const LogField& field) {
  return hashField(hash ^ field.width, Field{field.min, field.max, field.min, field.may_be_absent});
}

}  // namespace fathom::telemetry

#include "telemetry/wire/field.hpp"

#include <algorithm>

namespace fathom::telemetry {

std::uint64_t Field::encode(double value) const {
  if (std::isnan(value)) return may_be_absent ? lastCode() + 1 : 0;
  const double steps = (std::clamp(value, min, max) - min) / resolution;
  return std::min(static_cast<std::uint64_t>(steps + 0.5), lastCode());
}

double Field::decode(std::uint64_t code) const {
  if (code > lastCode()) return std::numeric_limits<double>::quiet_NaN();
  return min + static_cast<double>(code) * resolution;
}

std::uint64_t LogField::encode(double value) const {
  if (std::isnan(value)) return may_be_absent ? lastCode() + 1 : 0;
  if (value < min / 2) return 0;
  const double steps = static_cast<double>(lastCode() - 1) * std::log(value / min) / std::log(max / min);
  return 1 + static_cast<std::uint64_t>(std::clamp(steps, 0.0, static_cast<double>(lastCode() - 1)) + 0.5);
}

double LogField::decode(std::uint64_t code) const {
  if (code > lastCode()) return std::numeric_limits<double>::quiet_NaN();
  if (code == 0) return 0;
  return min * std::pow(max / min, static_cast<double>(code - 1) / static_cast<double>(lastCode() - 1));
}

void BitWriter::put(std::uint64_t value, unsigned bits) {
  if (bits > 64 || bits > bitsLeft()) ok_ = false;
  if (!ok_) return;
  for (unsigned i = bits; i-- > 0; ++bit_) {
    std::uint8_t& byte = out_[bit_ / 8];
    if (bit_ % 8 == 0) byte = 0;
    byte = static_cast<std::uint8_t>(byte | ((value >> i) & 1U) << (7 - bit_ % 8));
  }
}

std::uint64_t BitReader::get(unsigned bits) {
  if (bits > 64 || bits > bitsLeft()) ok_ = false;
  if (!ok_) return 0;
  std::uint64_t value = 0;
  for (unsigned i = 0; i < bits; ++i, ++bit_) value = value << 1 | ((in_[bit_ / 8] >> (7 - bit_ % 8)) & 1U);
  return value;
}

std::int64_t BitReader::getSigned(unsigned bits) {
  const std::uint64_t value = get(bits);
  if (bits == 0 || bits >= 64) return static_cast<std::int64_t>(value);
  const std::uint64_t sign = std::uint64_t{1} << (bits - 1);
  return static_cast<std::int64_t>((value ^ sign) - sign);
}

double BitReader::get(const Field& field) {
  const std::uint64_t code = get(field.bits());
  if (code > field.lastCode() + (field.may_be_absent ? 1 : 0)) ok_ = false;
  return field.decode(code);
}

bool BitReader::finished() {
  if (bitsLeft() >= 8) return false;
  return get(static_cast<unsigned>(bitsLeft())) == 0 && ok_;
}

}  // namespace fathom::telemetry

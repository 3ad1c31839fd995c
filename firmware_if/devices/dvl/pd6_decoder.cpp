#include "firmware_if/devices/dvl/pd6_decoder.hpp"

#include <charconv>
#include <cmath>
#include <cstring>
#include <string_view>

#include "realtime/base/civil_time.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kMaxPd6Fields = 8;
constexpr double kBadPd6Velocity_mmps = -32768;
constexpr double kLargestPd6Velocity_mmps = 32767;  // the binary formats' limit
constexpr double kLargestRange_m = 12000;

struct Pd6Fields {
  std::array<std::string_view, kMaxPd6Fields> text;
  std::size_t count = 0;
};

// Of the part behind the name; no fields when there are more than any line has.
Pd6Fields splitPd6(std::string_view line) {
  Pd6Fields fields;
  while (true) {
    const std::size_t comma = line.find(',');
    if (fields.count == kMaxPd6Fields) return Pd6Fields{};
    std::string_view field = line.substr(0, comma);
    while (!field.empty() && field.front() == ' ') field.remove_prefix(1);
    while (!field.empty() && field.back() == ' ') field.remove_suffix(1);
    fields.text[fields.count++] = field;
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

std::optional<double> pd6Number(std::string_view text, double min, double max) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double value = 0;
  const auto parsed =
      std::from_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed);
  if (parsed.ec != std::errc{} || parsed.ptr != text.data() + text.size()) return std::nullopt;
  if (!(value >= min && value <= max)) return std::nullopt;
  return value;
}

// YYMMDDHHmmsshh.
std::optional<std::int64_t> pd6ClockToUtc(std::string_view text) {
  if (text.size() != 14) return std::nullopt;
  std::array<int, 7> parts{};
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const char tens = text[2 * i], ones = text[2 * i + 1];
    if (tens < '0' || tens > '9' || ones < '0' || ones > '9') return std::nullopt;
    parts[i] = (tens - '0') * 10 + (ones - '0');
  }
  CivilTime civil;
  civil.year = parts[0] + (parts[0] >= 80 ? 1900 : 2000);
  civil.month = parts[1];
  civil.day = parts[2];
  civil.hour = parts[3];
  civil.minute = parts[4];
  civil.second = parts[5];
  civil.nanosecond = parts[6] * 10'000'000;
  return utcFromCivil(civil);
}

// Fields `x, y, z` [mm/s] and a status; std::nullopt when they make no sense. `good` says what the status
// says.
std::optional<Eigen::Vector3d> pd6Velocity(const Pd6Fields& fields, std::size_t status_at, bool& good) {
  if (fields.count != status_at + 1) return std::nullopt;
  const std::string_view status = fields.text[status_at];
  if (status != "A" && status != "V") return std::nullopt;
  Eigen::Vector3d starboard_forward_up;
  good = status == "A";
  for (std::size_t i = 0; i < 3; ++i) {
    const auto v = pd6Number(fields.text[i], kBadPd6Velocity_mmps, kLargestPd6Velocity_mmps);
    if (!v) return std::nullopt;
    if (*v == kBadPd6Velocity_mmps) good = false;
    starboard_forward_up(static_cast<Eigen::Index>(i)) = *v / 1000.0;
  }
  return starboard_forward_up;
}

}  // namespace

void Pd6Decoder::restart() noexcept {
  in_line_ = false;
  line_size_ = raw_size_ = raw_finished_ = 0;
  open_ = Pd6Ensemble{};
  instrument_line_ = velocity_good_ = any_ = false;
}

bool Pd6Decoder::push(std::uint8_t byte) noexcept {
  if (raw_finished_ > 0) restart();
  if (byte == ':') {
    // A line cut short before it is noise.
    counts_.skipped_bytes += in_line_ ? line_size_ : 0;
    in_line_ = true;
    line_size_ = 0;
  }
  if (!in_line_) {
    if (byte != '\n' && byte != '\r') ++counts_.skipped_bytes;
    return false;
  }
  const bool ends = byte == '\r' || byte == '\n';
  if (!ends && (byte < 0x20 || byte > 0x7E || line_size_ == line_.size())) {
    in_line_ = false;
    counts_.skipped_bytes += line_size_ + 1;
    return false;
  }
  if (!ends) {
    line_[line_size_++] = static_cast<char>(byte);
    return false;
  }
  in_line_ = false;
  const std::string_view line(line_.data(), line_size_);
  // An ensemble begins: what is left of one before it has lost its end.
  if (line.substr(0, 4) == ":SA,") restart();
  if (raw_size_ + line_size_ + 2 > raw_.size()) restart();
  std::memcpy(raw_.data() + raw_size_, line_.data(), line.size());
  raw_size_ += line.size();
  raw_[raw_size_++] = '\r';
  raw_[raw_size_++] = '\n';
  if (!readLine({line.data(), line.size()})) ++counts_.bad_lines;
  if (line.substr(0, 4) != ":BD,") return false;
  if (!any_) {
    restart();
    return false;
  }
  finished_ = open_;
  if (finished_.utc_ns) finished_.sample.utc_ns = *finished_.utc_ns;
  raw_finished_ = raw_size_;
  ++counts_.good;
  return true;
}

bool Pd6Decoder::readLine(std::span<const char> bytes) noexcept {
  const std::string_view line(bytes.data(), bytes.size());
  if (line.size() < 4 || line[3] != ',') return true;
  const std::string_view name = line.substr(1, 2);
  const Pd6Fields fields = splitPd6(line.substr(4));
  if (name == "TS") {
    if (fields.count != 6) return false;
    open_.utc_ns = pd6ClockToUtc(fields.text[0]);
    if (const auto speed = pd6Number(fields.text[4], 1300, 1700)) open_.sample.sound_speed = *speed;
    any_ = any_ || open_.utc_ns.has_value();
    return open_.utc_ns.has_value();
  }
  if (name == "BI" || (name == "BS" && !instrument_line_)) {
    const auto v = pd6Velocity(fields, name == "BI" ? 4 : 3, velocity_good_);
    if (!v) return false;
    any_ = true;
    instrument_line_ = instrument_line_ || name == "BI";
    open_.sample.velocity.reset();
    if (velocity_good_) open_.sample.velocity = Eigen::Vector3d{v->y(), v->x(), -v->z()};
    return true;
  }
  if (name == "BD") {
    if (fields.count != 5) return false;
    const auto range = pd6Number(fields.text[3], 0, kLargestRange_m);
    if (!range || !pd6Number(fields.text[4], 0, 1e6)) return false;
    // Without a good velocity the range is an earlier ensemble's.
    if (*range > 0 && velocity_good_) open_.sample.altitude = *range;
  }
  return true;
}

}  // namespace fathom::io

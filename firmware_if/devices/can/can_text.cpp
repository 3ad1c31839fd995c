#include "firmware_if/devices/can/can_text.hpp"

#include <algorithm>
#include <charconv>
#include <optional>
#include <system_error>

#include "realtime/base/civil_time.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

std::string_view trimmed(std::string_view text) noexcept {
  constexpr std::string_view kWhite = " \t\r";
  const std::size_t first = text.find_first_not_of(kWhite);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kWhite) - first + 1);
}

// The next word of `text`, up to one of `ends`, is taken off it; empty at its end.
std::string_view nextWord(std::string_view& text, std::string_view ends = " \t") noexcept {
  text = trimmed(text);
  const std::size_t end = std::min(text.find_first_of(ends), text.size());
  const std::string_view out = text.substr(0, end);
  text.remove_prefix(end);
  return out;
}

// All of `text` as a number.
template <class Integer>
bool parseWhole(std::string_view text, int base, Integer& value) noexcept {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc{} && end == text.data() + text.size();
}

// "668" in ns of a second.
bool parseFraction_ns(std::string_view digits, std::uint32_t& nanoseconds) noexcept {
  constexpr std::size_t kDigitsOfNanoseconds = 9;
  if (digits.size() > kDigitsOfNanoseconds || !parseWhole(digits, 10, nanoseconds)) return false;
  for (std::size_t i = digits.size(); i < kDigitsOfNanoseconds; ++i) nanoseconds *= 10;
  return true;
}

// kFrame when the identifier has 29 bits and no flag.
CanLine parseCanId(std::string_view digits, CanFrame& frame) noexcept {
  constexpr std::size_t kExtendedDigits = 8, kStandardDigits = 3;
  constexpr std::uint32_t kLargestExtendedId = 0x1FFFFFFF;  // above it are can-utils' error and remote flags
  std::uint32_t id = 0;
  if (digits.size() != kExtendedDigits && digits.size() != kStandardDigits) return CanLine::kBroken;
  if (!parseWhole(digits, 16, id)) return CanLine::kBroken;
  if (digits.size() == kStandardDigits || id > kLargestExtendedId) return CanLine::kOther;
  frame.id = id;
  return CanLine::kFrame;
}

// Two hexadecimal digits behind the bytes of a frame or packet; false where it is full.
template <class Holder>
bool appendHexByte(std::string_view digits, Holder& holder) noexcept {
  std::uint8_t byte = 0;
  if (digits.size() != 2 || holder.size >= holder.data.size() || !parseWhole(digits, 16, byte)) return false;
  holder.data[holder.size++] = byte;
  return true;
}

// "1502984866.421964" in ns, exactly: no floating point in between.
std::optional<std::int64_t> parseCandumpTime(std::string_view text) {
  constexpr std::uint64_t kLargestSeconds = 9'000'000'000;  // int64 ns end in the year 2262
  const std::size_t point = std::min(text.find('.'), text.size());
  std::uint64_t seconds = 0;
  if (!parseWhole(text.substr(0, point), 10, seconds) || seconds > kLargestSeconds) return std::nullopt;
  std::uint32_t nanoseconds = 0;
  if (point < text.size() && !parseFraction_ns(text.substr(point + 1), nanoseconds)) return std::nullopt;
  return static_cast<std::int64_t>(seconds * kSecond_ns + nanoseconds);
}

// "09F112CC#FF725A": bytes may be parted by dots.
CanLine parseCandumpLogForm(std::string_view text, CanFrame& frame) {
  const std::size_t hash = text.find('#');
  const CanLine kind = parseCanId(text.substr(0, hash), frame);
  if (kind != CanLine::kFrame) return kind;
  std::string_view data = text.substr(hash + 1);
  if (data.starts_with('#') || data.starts_with('R') || data.starts_with('r')) return CanLine::kOther;
  while (!data.empty()) {
    if (!appendHexByte(data.substr(0, 2), frame)) return CanLine::kBroken;
    data.remove_prefix(2);
    if (data.starts_with('.')) data.remove_prefix(1);
  }
  return CanLine::kFrame;
}

// "09F112CC   [8]  FF 72 5A ...": the words behind the interface.
CanLine parseCandumpScreenForm(std::string_view id, std::string_view rest, CanFrame& frame) {
  // With -x: direction and two flags before the identifier.
  if (id == "RX" || id == "TX") {
    (void)nextWord(rest);
    (void)nextWord(rest);
    id = nextWord(rest);
  }
  const CanLine kind = parseCanId(id, frame);
  if (kind == CanLine::kBroken) return kind;
  const std::string_view size = nextWord(rest);
  if (size.size() == 4 && size.front() == '[' && size.back() == ']') return CanLine::kOther;  // CAN FD: [08]
  if (size.size() != 3 || size.front() != '[' || size.back() != ']' || size[1] < '0' || size[1] > '8') {
    return CanLine::kBroken;
  }
  if (kind != CanLine::kFrame) return kind;
  for (int left = size[1] - '0'; left > 0; --left) {
    const std::string_view byte = nextWord(rest);
    if (byte == "remote") return CanLine::kOther;
    if (!appendHexByte(byte, frame)) return CanLine::kBroken;
  }
  return CanLine::kFrame;
}

constexpr std::uint32_t kLargestPgn = 0x3FFFF;
constexpr std::uint8_t kLargestPriority = 7;

// Whether `text` begins like `form`, in which 0 stands for any digit.
bool beginsLike(std::string_view text, std::string_view form) {
  if (text.size() < form.size()) return false;
  for (std::size_t k = 0; k < form.size(); ++k) {
    const bool digit = text[k] >= '0' && text[k] <= '9';
    if (form[k] == '0' ? !digit : text[k] != form[k]) return false;
  }
  return true;
}

// "2022-09-28-11:36:59.668", "2022-09-28T11:36:59.668Z"; no value for a moment that does not exist.
std::optional<std::int64_t> parseMoment(std::string_view text) {
  if (!beginsLike(text, "0000-00-00") || text.size() < 11 || !beginsLike(text.substr(11), "00:00:00"))
    return std::nullopt;
  const auto number = [&](std::size_t at, std::size_t digits) {
    int value = 0;
    (void)parseWhole(text.substr(at, digits), 10, value);  // they are digits
    return value;
  };
  CivilTime moment{number(0, 4), number(5, 2), number(8, 2), number(11, 2), number(14, 2), number(17, 2), 0};
  text.remove_prefix(19);
  if (text.ends_with('Z')) text.remove_suffix(1);
  if (!text.empty()) {
    std::uint32_t nanoseconds = 0;
    if (text.front() != '.' || !parseFraction_ns(text.substr(1), nanoseconds)) return std::nullopt;
    moment.nanosecond = static_cast<int>(nanoseconds);
  }
  return utcFromCivil(moment);
}

// canboat's plain form: time (UTC), priority, parameter group, source, destination, size, bytes:
// `2024-02-17T05:15:49.768Z,2,127250,204,255,8,ff,72,5a,ff,7f,ff,7f,fd`, with `-` for the T and no Z by older
// versions. A size of up to 8 may be a frame or a whole message: both are given, and kFrame. A group beyond
// 18 bits is a gateway's own, kOther.
bool isCanboatLine(std::string_view line) {
  return beginsLike(line, "0000-00-00") && line.find(',') != std::string_view::npos;
}

CanLine parseCanboatLine(std::string_view line, CanFrame& frame, N2kPacket& packet) {
  packet = N2kPacket{};
  const auto field = [&] {
    const std::string_view out = trimmed(nextWord(line, ","));
    if (!line.empty()) line.remove_prefix(1);
    return out;
  };
  packet.utc_ns = parseMoment(field());
  std::uint8_t size = 0;
  if (!parseWhole(field(), 10, packet.id.priority) || packet.id.priority > kLargestPriority ||
      !parseWhole(field(), 10, packet.id.pgn) || !parseWhole(field(), 10, packet.id.source) ||
      !parseWhole(field(), 10, packet.id.destination) || !parseWhole(field(), 10, size))
    return CanLine::kBroken;
  for (; size > 0; --size)
    if (!appendHexByte(field(), packet)) return CanLine::kBroken;
  if (!trimmed(line).empty()) return CanLine::kBroken;
  if (packet.id.pgn > kLargestPgn) return CanLine::kOther;
  if (packet.size > frame.data.size()) return CanLine::kPacket;
  frame = CanFrame{packet.utc_ns, makeN2kId(packet.id), packet.size, {}};
  std::copy_n(packet.data.begin(), packet.size, frame.data.begin());
  return CanLine::kFrame;
}

// Yacht Devices' RAW (YDWG-02 and others): time of day, R(eceived) or T(ransmitted), identifier, bytes:
// `17:33:21.107 R 19F51323 01 2F 30 70 00 2F 30 70`. Without a date the time is absent.
bool isYachtDevicesLine(std::string_view line) {
  return beginsLike(line, "00:00:00");
}

CanLine parseYachtDevicesLine(std::string_view line, CanFrame& frame) {
  frame = CanFrame{};
  (void)nextWord(line);  // the time of day
  const std::string_view direction = nextWord(line);
  if (direction != "R" && direction != "T") return CanLine::kBroken;
  const CanLine kind = parseCanId(nextWord(line), frame);
  if (kind != CanLine::kFrame) return kind;
  for (std::string_view byte = nextWord(line); !byte.empty(); byte = nextWord(line))
    if (!appendHexByte(byte, frame)) return CanLine::kBroken;
  return CanLine::kFrame;
}

// Actisense's N2K ASCII (NGT-1, W2K-1): time of day, source with destination and priority, parameter group,
// all bytes of the message: `A173321.107 23FF7 1F513 012F3070002F30709F`. Without a date the time is absent.
bool isActisenseLine(std::string_view line) {
  return beginsLike(line, "A000000.000 ");
}

CanLine parseActisenseLine(std::string_view line, N2kPacket& packet) {
  packet = N2kPacket{};
  (void)nextWord(line);  // the time of day
  std::uint32_t addresses = 0;
  if (!parseWhole(nextWord(line), 16, addresses) || addresses > 0xFFFFF ||
      (addresses & 0xF) > kLargestPriority || !parseWhole(nextWord(line), 16, packet.id.pgn))
    return CanLine::kBroken;
  packet.id.source = static_cast<std::uint8_t>(addresses >> 12);
  packet.id.destination = static_cast<std::uint8_t>(addresses >> 4);
  packet.id.priority = static_cast<std::uint8_t>(addresses & 0xF);
  for (std::string_view bytes = nextWord(line); !bytes.empty(); bytes = nextWord(line))
    for (; !bytes.empty(); bytes.remove_prefix(2))
      if (!appendHexByte(bytes.substr(0, 2), packet)) return CanLine::kBroken;
  return packet.id.pgn > kLargestPgn ? CanLine::kOther : CanLine::kPacket;
}

}  // namespace

CanLine parseCandumpLine(std::string_view line, CanFrame& frame) noexcept {
  frame = CanFrame{};
  line = trimmed(line);
  if (line.empty() || line.front() == '#') return CanLine::kBlank;
  if (line.front() == '(') {
    const std::size_t close = line.find(')');
    if (close == std::string_view::npos) return CanLine::kBroken;
    frame.utc_ns = parseCandumpTime(trimmed(line.substr(1, close - 1)));
    line.remove_prefix(close + 1);
  }
  const std::string_view interface = nextWord(line);
  const std::string_view body = nextWord(line);
  if (interface.empty() || body.empty()) return CanLine::kBroken;
  if (body.find('#') != std::string_view::npos) return parseCandumpLogForm(body, frame);
  return parseCandumpScreenForm(body, line, frame);
}

CanLine CanTextReader::readLine(std::string_view line) noexcept {
  line = trimmed(line);
  if (line.empty() || line.front() == '#') return CanLine::kBlank;
  if (isCanboatLine(line)) {
    const CanLine kind = parseCanboatLine(line, frame_, packet_);
    whole_ = whole_ || kind == CanLine::kPacket;
    return whole_ && kind == CanLine::kFrame ? CanLine::kPacket : kind;
  }
  if (isYachtDevicesLine(line)) return parseYachtDevicesLine(line, frame_);
  if (isActisenseLine(line)) return parseActisenseLine(line, packet_);
  return parseCandumpLine(line, frame_);
}

CanLine CanTextReader::endLine() noexcept {
  const CanLine kind = size_ > line_.size() ? CanLine::kBroken : readLine({line_.data(), size_});
  size_ = 0;
  counts_.frames += kind == CanLine::kFrame;
  counts_.packets += kind == CanLine::kPacket;
  counts_.other += kind == CanLine::kOther;
  counts_.broken += kind == CanLine::kBroken;
  return kind;
}

}  // namespace fathom::io

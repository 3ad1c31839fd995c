#include "firmware_if/can/gateway_text.hpp"

#include <cstddef>
#include <optional>

#include "firmware_if/files/civil_time.hpp"

namespace fathom::io {
namespace {

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
    (void)parse(text.substr(at, digits), 10, value);  // they are digits
    return value;
  };
  CivilTime moment{number(0, 4), number(5, 2), number(8, 2), number(11, 2), number(14, 2), number(17, 2), 0};
  text.remove_prefix(19);
  if (text.ends_with('Z')) text.remove_suffix(1);
  if (!text.empty()) {
    std::uint32_t nanoseconds = 0;
    if (text.front() != '.' || !parseFraction(text.substr(1), nanoseconds)) return std::nullopt;
    moment.nanosecond = static_cast<int>(nanoseconds);
  }
  return utcFromCivil(moment);
}

}  // namespace

bool isCanboatLine(std::string_view line) noexcept {
  return beginsLike(line, "0000-00-00") && line.find(',') != std::string_view::npos;
}

CanLine parseCanboatLine(std::string_view line, CanFrame& frame, N2kPacket& packet) noexcept {
  packet = N2kPacket{};
  const auto field = [&] {
    const std::string_view out = trim(word(line, ","));
    if (!line.empty()) line.remove_prefix(1);
    return out;
  };
  packet.utc_ns = parseMoment(field());
  std::uint8_t size = 0;
  if (!parse(field(), 10, packet.id.priority) || packet.id.priority > kLargestPriority ||
      !parse(field(), 10, packet.id.pgn) || !parse(field(), 10, packet.id.source) ||
      !parse(field(), 10, packet.id.destination) || !parse(field(), 10, size))
    return CanLine::kBroken;
  for (; size > 0; --size)
    if (!appendByte(field(), packet)) return CanLine::kBroken;
  if (!trim(line).empty()) return CanLine::kBroken;
  if (packet.id.pgn > kLargestPgn) return CanLine::kOther;
  if (packet.size > frame.data.size()) return CanLine::kPacket;
  frame = CanFrame{packet.utc_ns, makeN2kId(packet.id), packet.size, {}};
  std::copy_n(packet.data.begin(), packet.size, frame.data.begin());
  return CanLine::kFrame;
}

bool isYachtDevicesLine(std::string_view line) noexcept {
  return beginsLike(line, "00:00:00");
}

CanLine parseYachtDevicesLine(std::string_view line, CanFrame& frame) noexcept {
  frame = CanFrame{};
  (void)word(line);  // the time of day
  const std::string_view direction = word(line);
  if (direction != "R" && direction != "T") return CanLine::kBroken;
  const CanLine kind = parseId(word(line), frame);
  if (kind != CanLine::kFrame) return kind;
  for (std::string_view byte = word(line); !byte.empty(); byte = word(line))
    if (!appendByte(byte, frame)) return CanLine::kBroken;
  return CanLine::kFrame;
}

bool isActisenseLine(std::string_view line) noexcept {
  return beginsLike(line, "A000000.000 ");
}

CanLine parseActisenseLine(std::string_view line, N2kPacket& packet) noexcept {
  packet = N2kPacket{};
  (void)word(line);  // the time of day
  std::uint32_t addresses = 0;
  if (!parse(word(line), 16, addresses) || addresses > 0xFFFFF || (addresses & 0xF) > kLargestPriority ||
      !parse(word(line), 16, packet.id.pgn))
    return CanLine::kBroken;
  packet.id.source = static_cast<std::uint8_t>(addresses >> 12);
  packet.id.destination = static_cast<std::uint8_t>(addresses >> 4);
  packet.id.priority = static_cast<std::uint8_t>(addresses & 0xF);
  for (std::string_view bytes = word(line); !bytes.empty(); bytes = word(line))
    for (; !bytes.empty(); bytes.remove_prefix(2))
      if (!appendByte(bytes.substr(0, 2), packet)) return CanLine::kBroken;
  return packet.id.pgn > kLargestPgn ? CanLine::kOther : CanLine::kPacket;
}

}  // namespace fathom::io

#include "firmware_if/can/candump.hpp"

#include <cstddef>
#include <optional>

namespace fathom::io {
namespace {

// "1502984866.421964" in ns, without going through floating point.
std::optional<std::int64_t> parseSeconds(std::string_view text) {
  constexpr std::uint64_t kLargestSeconds = 9'000'000'000;  // int64 ns end in the year 2262
  const std::size_t point = std::min(text.find('.'), text.size());
  std::uint64_t seconds = 0;
  if (!parse(text.substr(0, point), 10, seconds) || seconds > kLargestSeconds) return std::nullopt;
  std::uint32_t nanoseconds = 0;
  if (point < text.size() && !parseFraction(text.substr(point + 1), nanoseconds)) return std::nullopt;
  return static_cast<std::int64_t>(seconds * 1'000'000'000 + nanoseconds);
}

// "09F112CC#FF725A": bytes may be parted by dots.
CanLine parseLogForm(std::string_view text, CanFrame& frame) {
  const std::size_t hash = text.find('#');
  const CanLine kind = parseId(text.substr(0, hash), frame);
  if (kind != CanLine::kFrame) return kind;
  std::string_view data = text.substr(hash + 1);
  if (data.starts_with('#') || data.starts_with('R') || data.starts_with('r')) return CanLine::kOther;
  while (!data.empty()) {
    if (!appendByte(data.substr(0, 2), frame)) return CanLine::kBroken;
    data.remove_prefix(2);
    if (data.starts_with('.')) data.remove_prefix(1);
  }
  return CanLine::kFrame;
}

// "09F112CC   [8]  FF 72 5A ...": the words behind the interface.
CanLine parseScreenForm(std::string_view id, std::string_view rest, CanFrame& frame) {
  // With -x: direction and two flags before the identifier.
  if (id == "RX" || id == "TX") {
    (void)word(rest);
    (void)word(rest);
    id = word(rest);
  }
  const CanLine kind = parseId(id, frame);
  if (kind == CanLine::kBroken) return kind;
  const std::string_view size = word(rest);
  if (size.size() == 4 && size.front() == '[' && size.back() == ']') return CanLine::kOther;  // CAN FD: [08]
  if (size.size() != 3 || size.front() != '[' || size.back() != ']' || size[1] < '0' || size[1] > '8') {
    return CanLine::kBroken;
  }
  if (kind != CanLine::kFrame) return kind;
  for (int left = size[1] - '0'; left > 0; --left) {
    const std::string_view byte = word(rest);
    if (byte == "remote") return CanLine::kOther;
    if (!appendByte(byte, frame)) return CanLine::kBroken;
  }
  return CanLine::kFrame;
}

}  // namespace

CanLine parseCandumpLine(std::string_view line, CanFrame& frame) noexcept {
  frame = CanFrame{};
  line = trim(line);
  if (line.empty() || line.front() == '#') return CanLine::kBlank;
  if (line.front() == '(') {
    const std::size_t close = line.find(')');
    if (close == std::string_view::npos) return CanLine::kBroken;
    frame.utc_ns = parseSeconds(trim(line.substr(1, close - 1)));
    line.remove_prefix(close + 1);
  }
  const std::string_view interface = word(line);
  const std::string_view body = word(line);
  if (interface.empty() || body.empty()) return CanLine::kBroken;
  if (body.find('#') != std::string_view::npos) return parseLogForm(body, frame);
  return parseScreenForm(body, line, frame);
}

}  // namespace fathom::io

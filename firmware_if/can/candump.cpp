#include "firmware_if/can/candump.hpp"

#include <charconv>
#include <optional>

namespace fathom::io {
namespace {

constexpr std::size_t kExtendedDigits = 8;
constexpr std::size_t kStandardDigits = 3;
constexpr std::uint32_t kLargestExtendedId = 0x1FFFFFFF;  // above it are can-utils' error and remote flags

std::string_view trim(std::string_view text) {
  constexpr std::string_view kWhite = " \t\r";
  const std::size_t first = text.find_first_not_of(kWhite);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kWhite) - first + 1);
}

// Takes the next word off `text`; empty at the end.
std::string_view word(std::string_view& text) {
  text = trim(text);
  const std::size_t end = std::min(text.find_first_of(" \t"), text.size());
  const std::string_view out = text.substr(0, end);
  text.remove_prefix(end);
  return out;
}

template <class Integer>
bool parse(std::string_view text, int base, Integer& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc{} && end == text.data() + text.size();
}

// "1502984866.421964" in ns, without going through floating point.
std::optional<std::int64_t> parseSeconds(std::string_view text) {
  constexpr std::size_t kDigitsOfNanoseconds = 9;
  constexpr std::uint64_t kLargestSeconds = 9'000'000'000;  // int64 ns end in the year 2262
  const std::size_t point = std::min(text.find('.'), text.size());
  std::uint64_t seconds = 0;
  if (!parse(text.substr(0, point), 10, seconds) || seconds > kLargestSeconds) return std::nullopt;
  std::uint64_t nanoseconds = 0;
  if (point < text.size()) {
    const std::string_view fraction = text.substr(point + 1);
    if (fraction.empty() || fraction.size() > kDigitsOfNanoseconds || !parse(fraction, 10, nanoseconds)) {
      return std::nullopt;
    }
    for (std::size_t i = fraction.size(); i < kDigitsOfNanoseconds; ++i) nanoseconds *= 10;
  }
  return static_cast<std::int64_t>(seconds * 1'000'000'000 + nanoseconds);
}

// kFrame when the identifier has 29 bits and no flag.
CandumpLine parseId(std::string_view digits, CanFrame& frame) {
  std::uint32_t id = 0;
  if (digits.size() != kExtendedDigits && digits.size() != kStandardDigits) return CandumpLine::kBroken;
  if (!parse(digits, 16, id)) return CandumpLine::kBroken;
  if (digits.size() == kStandardDigits || id > kLargestExtendedId) return CandumpLine::kOther;
  frame.id = id;
  return CandumpLine::kFrame;
}

bool appendByte(std::string_view digits, CanFrame& frame) {
  std::uint8_t byte = 0;
  if (digits.size() != 2 || frame.size >= frame.data.size() || !parse(digits, 16, byte)) return false;
  frame.data[frame.size++] = byte;
  return true;
}

// "09F112CC#FF725A": bytes may be parted by dots.
CandumpLine parseLogForm(std::string_view text, CanFrame& frame) {
  const std::size_t hash = text.find('#');
  const CandumpLine kind = parseId(text.substr(0, hash), frame);
  if (kind != CandumpLine::kFrame) return kind;
  std::string_view data = text.substr(hash + 1);
  if (data.starts_with('#') || data.starts_with('R') || data.starts_with('r')) return CandumpLine::kOther;
  while (!data.empty()) {
    if (!appendByte(data.substr(0, 2), frame)) return CandumpLine::kBroken;
    data.remove_prefix(2);
    if (data.starts_with('.')) data.remove_prefix(1);
  }
  return CandumpLine::kFrame;
}

// "09F112CC   [8]  FF 72 5A ...": the words behind the interface.
CandumpLine parseScreenForm(std::string_view id, std::string_view rest, CanFrame& frame) {
  // With -x: direction and two flags before the identifier.
  if (id == "RX" || id == "TX") {
    (void)word(rest);
    (void)word(rest);
    id = word(rest);
  }
  const CandumpLine kind = parseId(id, frame);
  if (kind == CandumpLine::kBroken) return kind;
  const std::string_view size = word(rest);
  if (size.size() == 4 && size.front() == '[' && size.back() == ']')
    return CandumpLine::kOther;  // CAN FD: [08]
  if (size.size() != 3 || size.front() != '[' || size.back() != ']' || size[1] < '0' || size[1] > '8') {
    return CandumpLine::kBroken;
  }
  if (kind != CandumpLine::kFrame) return kind;
  for (int left = size[1] - '0'; left > 0; --left) {
    const std::string_view byte = word(rest);
    if (byte == "remote") return CandumpLine::kOther;
    if (!appendByte(byte, frame)) return CandumpLine::kBroken;
  }
  return CandumpLine::kFrame;
}

}  // namespace

CandumpLine parseCandumpLine(std::string_view line, CanFrame& frame) noexcept {
  frame = CanFrame{};
  line = trim(line);
  if (line.empty() || line.front() == '#') return CandumpLine::kBlank;
  if (line.front() == '(') {
    const std::size_t close = line.find(')');
    if (close == std::string_view::npos) return CandumpLine::kBroken;
    frame.utc_ns = parseSeconds(trim(line.substr(1, close - 1)));
    line.remove_prefix(close + 1);
  }
  const std::string_view interface = word(line);
  const std::string_view body = word(line);
  if (interface.empty() || body.empty()) return CandumpLine::kBroken;
  if (body.find('#') != std::string_view::npos) return parseLogForm(body, frame);
  return parseScreenForm(body, line, frame);
}

const CanFrame* CandumpReader::endLine() noexcept {
  const std::size_t size = size_;
  size_ = 0;
  if (size > line_.size()) {
    ++counts_.broken;
    return nullptr;
  }
  switch (parseCandumpLine({line_.data(), size}, frame_)) {
    case CandumpLine::kFrame:
      ++counts_.frames;
      return &frame_;
    case CandumpLine::kOther:
      ++counts_.other;
      break;
    case CandumpLine::kBroken:
      ++counts_.broken;
      break;
    case CandumpLine::kBlank:
      break;
  }
  return nullptr;
}

}  // namespace fathom::io

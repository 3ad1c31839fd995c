#pragma once

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <string_view>
#include <system_error>

#include "firmware_if/can/can_frame.hpp"

namespace fathom::io {

// What a line of a text capture is.
enum class CanLine : std::uint8_t {
  kFrame,   // an extended data frame
  kPacket,  // a whole message
  kBlank,   // empty, or a comment that begins with #
  kOther,   // a CAN line, but neither: 11-bit identifier, remote, error or CAN FD frame, a gateway's own
  kBroken,  // none of these
};

// The pieces that such lines are read by.

inline std::string_view trim(std::string_view text) noexcept {
  constexpr std::string_view kWhite = " \t\r";
  const std::size_t first = text.find_first_not_of(kWhite);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kWhite) - first + 1);
}

// Takes the next word off `text`, which ends at one of `ends`; empty at the end.
inline std::string_view word(std::string_view& text, std::string_view ends = " \t") noexcept {
  text = trim(text);
  const std::size_t end = std::min(text.find_first_of(ends), text.size());
  const std::string_view out = text.substr(0, end);
  text.remove_prefix(end);
  return out;
}

// All of `text` as a number.
template <class Integer>
bool parse(std::string_view text, int base, Integer& value) noexcept {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc{} && end == text.data() + text.size();
}

// "668" in ns of a second.
inline bool parseFraction(std::string_view digits, std::uint32_t& nanoseconds) noexcept {
  constexpr std::size_t kDigitsOfNanoseconds = 9;
  if (digits.size() > kDigitsOfNanoseconds || !parse(digits, 10, nanoseconds)) return false;
  for (std::size_t i = digits.size(); i < kDigitsOfNanoseconds; ++i) nanoseconds *= 10;
  return true;
}

// kFrame when the identifier has 29 bits and no flag.
inline CanLine parseId(std::string_view digits, CanFrame& frame) noexcept {
  constexpr std::size_t kExtendedDigits = 8, kStandardDigits = 3;
  constexpr std::uint32_t kLargestExtendedId = 0x1FFFFFFF;  // above it are can-utils' error and remote flags
  std::uint32_t id = 0;
  if (digits.size() != kExtendedDigits && digits.size() != kStandardDigits) return CanLine::kBroken;
  if (!parse(digits, 16, id)) return CanLine::kBroken;
  if (digits.size() == kStandardDigits || id > kLargestExtendedId) return CanLine::kOther;
  frame.id = id;
  return CanLine::kFrame;
}

// Two hexadecimal digits behind the bytes of a frame or packet; false where it is full.
template <class Holder>
bool appendByte(std::string_view digits, Holder& holder) noexcept {
  std::uint8_t byte = 0;
  if (digits.size() != 2 || holder.size >= holder.data.size() || !parse(digits, 16, byte)) return false;
  holder.data[holder.size++] = byte;
  return true;
}

}  // namespace fathom::io

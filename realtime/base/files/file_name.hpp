#pragma once

#include <algorithm>
#include <array>
#include <cassert>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace fathom {

// A file's name within its folder, stored in place: construction and copies use no heap.
class FileName {
 public:
  static constexpr std::size_t kMost = 63;  // characters; more is a broken contract

  FileName() = default;
  template <typename Text>
  requires std::convertible_to<const Text&, std::string_view> FileName(const Text& text)
  noexcept {
    const std::string_view view = text;
    assert(view.size() <= kMost);
    size_ = static_cast<std::uint8_t>(view.size());
    std::copy(view.begin(), view.end(), text_.begin());
  }

  [[nodiscard]] std::string_view view() const noexcept { return {text_.data(), size_}; }
  operator std::string() const { return std::string(view()); }
  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }
  bool operator==(const FileName&) const = default;

 private:
  std::array<char, kMost> text_{};
  std::uint8_t size_ = 0;
};

}  // namespace fathom

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <string>
#include <string_view>

namespace fathom::io {

// A text of at most `kMost` bytes that owns no memory; longer ones are cut.
template <std::size_t kMost>
class ShortText {
  static_assert(kMost <= UINT8_MAX);

 public:
  static constexpr std::size_t kMax = kMost;
  constexpr ShortText() = default;
  ShortText(std::string_view text) noexcept {  // NOLINT: texts are written as literals
    size_ = static_cast<std::uint8_t>(text.size() < kMax ? text.size() : kMax);
    if (size_ > 0) std::memcpy(text_.data(), text.data(), size_);
  }
  ShortText(const char* text) noexcept : ShortText(std::string_view(text)) {}         // NOLINT
  ShortText(const std::string& text) noexcept : ShortText(std::string_view(text)) {}  // NOLINT
  [[nodiscard]] std::string_view view() const noexcept { return {text_.data(), size_}; }
  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }
  friend bool operator==(const ShortText& a, const ShortText& b) noexcept { return a.view() == b.view(); }

 private:
  std::array<char, kMax> text_{};
  std::uint8_t size_ = 0;
};

using ShortName = ShortText<31>;

// Up to N values in place, in the order in which they were added.
template <typename T, std::size_t N>
class ShortList {
 public:
  ShortList() = default;
  ShortList(std::initializer_list<T> values) noexcept {
    for (const T& value : values) add(value);
  }
  // False, and nothing added, when full.
  bool add(const T& value) noexcept {
    if (size_ == N) return false;
    values_[size_++] = value;
    return true;
  }
  void clear() noexcept { size_ = 0; }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] static constexpr std::size_t capacity() noexcept { return N; }
  [[nodiscard]] const T& operator[](std::size_t i) const noexcept { return values_[i]; }
  [[nodiscard]] const T* begin() const noexcept { return values_.data(); }
  [[nodiscard]] const T* end() const noexcept { return values_.data() + size_; }

 private:
  std::array<T, N> values_{};
  std::size_t size_ = 0;
};

}  // namespace fathom::io

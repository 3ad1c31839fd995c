#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

namespace fathom::io {

// A name of at most 31 characters that owns no memory; longer ones are cut.
class ShortName {
 public:
  static constexpr std::size_t kMax = 31;
  constexpr ShortName() = default;
  ShortName(std::string_view name) noexcept {  // NOLINT: names are written as literals
    size_ = static_cast<std::uint8_t>(name.size() < kMax ? name.size() : kMax);
    if (size_ > 0) std::memcpy(text_.data(), name.data(), size_);
  }
  ShortName(const char* name) noexcept : ShortName(std::string_view(name)) {}         // NOLINT
  ShortName(const std::string& name) noexcept : ShortName(std::string_view(name)) {}  // NOLINT
  [[nodiscard]] std::string_view view() const noexcept { return {text_.data(), size_}; }
  friend bool operator==(const ShortName& a, const ShortName& b) noexcept { return a.view() == b.view(); }

 private:
  std::array<char, kMax> text_{};
  std::uint8_t size_ = 0;
};

// Up to N values in place, in the order in which they were added.
template <typename T, std::size_t N>
class ShortList {
 public:
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

#pragma once

#include <array>
#include <cstddef>

#include "firmware_if/devices/short_text.hpp"

namespace fathom::io {

using ShortName = ShortText<31>;

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

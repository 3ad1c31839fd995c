#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace fathom::rt {

// The newest value from one writing thread to one reading thread; wait-free on both sides, never torn (triple
// buffer: the writer fills a private buffer and exchanges it for the middle one; the reader takes the middle
// one when it is fresh). A slow reader misses intermediate values.
template <typename T>
class LatestValue {
  static_assert(std::is_nothrow_copy_assignable_v<T> && std::is_nothrow_default_constructible_v<T>);

 public:
  LatestValue() = default;
  LatestValue(const LatestValue&) = delete;
  LatestValue& operator=(const LatestValue&) = delete;

  // Writer only.
  void write(const T& value) noexcept {
    buffers_[back_] = value;
    back_ = middle_.exchange(static_cast<std::uint8_t>(back_ | kFresh), std::memory_order_acq_rel) & kIndex;
  }

  // Reader only. Copies the newest value, whether or not it was read before; false (and `value` untouched)
  // when nothing was ever written.
  [[nodiscard]] bool read(T& value) noexcept {
    takeFresh();
    if (!any_) return false;
    value = buffers_[front_];
    return true;
  }

  // Reader only. The same, but false unless the value is newer than the last one read.
  [[nodiscard]] bool readNew(T& value) noexcept {
    if (!takeFresh()) return false;
    value = buffers_[front_];
    return true;
  }

 private:
  static constexpr std::uint8_t kFresh = 4;
  static constexpr std::uint8_t kIndex = 3;

  bool takeFresh() noexcept {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
    any_ = true;
    return true;
  }

  std::array<T, 3> buffers_{};
  std::atomic<std::uint8_t> middle_{1};  // buffer index, and kFresh when the reader has not seen it
  std::uint8_t back_ = 0;                // the writer's
  std::uint8_t front_ = 2;               // the reader's
  bool any_ = false;                     // the reader's
};

}  // namespace fathom::rt

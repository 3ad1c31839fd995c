#pragma once

#include <array>
#include <cassert>
#include <cstddef>
#include <cstdint>

namespace fathom::rt {

// First-in first-out queue of fixed capacity for one thread, with access by position; position 0 is the
// oldest element.
template <typename T, std::size_t Capacity>
class FixedQueue {
  static_assert(Capacity > 0);

 public:
  // When full: false, counted, nothing changed.
  [[nodiscard]] bool push(const T& value) noexcept {
    if (full()) {
      ++refused_;
      return false;
    }
    slots_[wrap(first_ + size_)] = value;
    if (++size_ > high_water_) high_water_ = size_;
    return true;
  }
  // Drops the oldest element when full; true when it had to.
  bool pushDroppingOldest(const T& value) noexcept {
    const bool drop = full();
    if (drop) popFront();
    const bool pushed = push(value);
    assert(pushed);
    return drop && pushed;
  }
  void popFront() noexcept {
    assert(size_ > 0);
    first_ = wrap(first_ + 1);
    --size_;
  }
  // Takes out the element at `position`; those after it move up.
  void erase(std::size_t position) noexcept {
    assert(position < size_);
    for (std::size_t i = position; i + 1 < size_; ++i) (*this)[i] = (*this)[i + 1];
    --size_;
  }
  void clear() noexcept { size_ = 0; }

  [[nodiscard]] T& operator[](std::size_t position) noexcept {
    assert(position < size_);
    return slots_[wrap(first_ + position)];
  }
  [[nodiscard]] const T& operator[](std::size_t position) const noexcept {
    assert(position < size_);
    return slots_[wrap(first_ + position)];
  }
  [[nodiscard]] const T& front() const noexcept { return (*this)[0]; }
  [[nodiscard]] const T& back() const noexcept { return (*this)[size_ - 1]; }

  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }
  [[nodiscard]] bool full() const noexcept { return size_ == Capacity; }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] static constexpr std::size_t capacity() noexcept { return Capacity; }
  [[nodiscard]] std::size_t highWater() const noexcept { return high_water_; }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_; }

  // For saved state (state_archive.hpp).
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t size = self.size_, high_water = self.high_water_;
    archive(size, high_water, self.refused_);
    archive.require(size <= high_water && high_water <= Capacity, "a queue is longer than its room");
    if constexpr (Archive::kLoading) {
      if (!archive.ok()) return;
      self.first_ = 0;
      self.size_ = size;
      self.high_water_ = high_water;
    }
    for (std::size_t i = 0; i < self.size_; ++i) archive(self[i]);
  }

 private:
  static constexpr std::size_t wrap(std::size_t i) noexcept { return i < Capacity ? i : i - Capacity; }

  std::array<T, Capacity> slots_{};
  std::size_t first_ = 0;
  std::size_t size_ = 0;
  std::size_t high_water_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace fathom::rt

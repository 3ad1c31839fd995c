#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace fathom::rt {

// Size of the cache lines kept apart so that the two ends of a queue do not slow each other down [bytes].
inline constexpr std::size_t kCacheLine = 64;

// Queue from exactly one producing thread to exactly one consuming thread; wait-free on both sides. Full:
// push returns false, drops the new element and counts it, so that a slow reader never holds up the writer.
// Where the other end is a process that may write anything, counts that cannot be leave it empty; what is
// popped is then whatever was written.
template <typename T, std::size_t Capacity>
class SpscRing {
  static_assert(Capacity > 0 && (Capacity & (Capacity - 1)) == 0, "the capacity is a power of two");
  static_assert(std::is_nothrow_copy_assignable_v<T> && std::is_nothrow_default_constructible_v<T>);

 public:
  SpscRing() = default;
  SpscRing(const SpscRing&) = delete;
  SpscRing& operator=(const SpscRing&) = delete;

  // Producer only. False when full.
  [[nodiscard]] bool push(const T& value) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    const std::size_t size = tail - head_.load(std::memory_order_acquire);
    if (size >= Capacity) {
      refused_.store(refused_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
      return false;
    }
    slots_[tail % Capacity] = value;
    tail_.store(tail + 1, std::memory_order_release);
    if (size + 1 > high_water_.load(std::memory_order_relaxed))
      high_water_.store(size + 1, std::memory_order_relaxed);
    return true;
  }

  // Consumer only. False (and `value` untouched) when empty.
  [[nodiscard]] bool pop(T& value) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    const std::size_t tail = tail_.load(std::memory_order_acquire);
    if (head == tail) return false;
    if (tail - head > Capacity) {
      head_.store(tail, std::memory_order_release);
      return false;
    }
    value = slots_[head % Capacity];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  [[nodiscard]] static constexpr std::size_t capacity() noexcept { return Capacity; }
  // From any thread; exact only while both ends rest.
  [[nodiscard]] std::size_t used() const noexcept {
    const std::size_t head = head_.load(std::memory_order_acquire);
    const std::size_t size = tail_.load(std::memory_order_acquire) - head;
    return size < Capacity ? size : Capacity;
  }
  [[nodiscard]] std::size_t free() const noexcept { return Capacity - used(); }
  // Most elements ever waiting, as the producer saw it; and pushes refused because the ring was full.
  [[nodiscard]] std::size_t highWater() const noexcept { return high_water_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

 private:
  // Counts of elements ever pushed and popped; their difference stays right when they wrap around.
  alignas(kCacheLine) std::atomic<std::size_t> tail_{0};
  std::atomic<std::size_t> high_water_{0};
  std::atomic<std::uint64_t> refused_{0};
  alignas(kCacheLine) std::atomic<std::size_t> head_{0};
  alignas(kCacheLine) std::array<T, Capacity> slots_{};
};

}  // namespace fathom::rt

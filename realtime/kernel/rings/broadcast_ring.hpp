#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
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

// A value stored as atomic words, so that it crosses threads or processes without a lock. For types without
// pointers, completely represented by their bytes.
template <typename T>
class SharedBytes {
  static_assert(std::is_nothrow_copy_assignable_v<T> && std::is_trivially_destructible_v<T>);
  static constexpr std::size_t kWords = (sizeof(T) + sizeof(std::uint64_t) - 1) / sizeof(std::uint64_t);
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free, "shared between processes");

 public:
  void store(const T& value) noexcept {
    std::array<std::uint64_t, kWords> words{};
    // Eigen's fixed matrices are copied as bytes, though they do not say so.
    // NOLINTNEXTLINE(bugprone-undefined-memory-manipulation)
    std::memcpy(words.data(), &value, sizeof value);
    for (std::size_t i = 0; i < kWords; ++i) words_[i].store(words[i], std::memory_order_relaxed);
  }
  // Copies the words. They form a whole value only if the caller verifies afterwards that no store() ran
  // meanwhile.
  void load(std::array<std::uint64_t, kWords>& words) const noexcept {
    for (std::size_t i = 0; i < kWords; ++i) words[i] = words_[i].load(std::memory_order_relaxed);
  }
  static void give(const std::array<std::uint64_t, kWords>& words, T& value) noexcept {
    std::memcpy(static_cast<void*>(&value), words.data(), sizeof value);
  }
  using Words = std::array<std::uint64_t, kWords>;

 private:
  std::array<std::atomic<std::uint64_t>, kWords> words_{};
};

// Log in memory: one writer appends, any number of readers read by position. The writer does not know its
// readers, so that none can delay or damage it. Keeps the newest `Capacity` entries. Wait-free; also between
// processes, in memory that readers cannot write.
template <typename T, std::size_t Capacity>
class BroadcastRing {
  static_assert(Capacity > 0 && (Capacity & (Capacity - 1)) == 0, "the capacity is a power of two");

 public:
  enum class Read : std::uint8_t { kGot, kNotYet, kOverrun };

  BroadcastRing() = default;
  BroadcastRing(const BroadcastRing&) = delete;
  BroadcastRing& operator=(const BroadcastRing&) = delete;

  // Writer only, before the first push(): its position.
  void start(std::uint64_t position) noexcept {
    first_.store(position, std::memory_order_relaxed);
    next_.store(position, std::memory_order_release);
  }
  // Writer only.
  void push(const T& value) noexcept {
    const std::uint64_t position = next_.load(std::memory_order_relaxed);
    // Readers of what is about to be overwritten must see that it is.
    begun_.store(position + 1, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    slots_[position % Capacity].store(value);
    next_.store(position + 1, std::memory_order_release);
  }

  // `value` is untouched unless it was got.
  [[nodiscard]] Read read(std::uint64_t position, T& value) const noexcept {
    const std::uint64_t next = next_.load(std::memory_order_acquire);
    if (position >= next) return Read::kNotYet;
    if (position < first_.load(std::memory_order_relaxed) || next - position > Capacity)
      return Read::kOverrun;
    typename SharedBytes<T>::Words words;
    slots_[position % Capacity].load(words);
    std::atomic_thread_fence(std::memory_order_acquire);
    if (begun_.load(std::memory_order_relaxed) > position + Capacity) return Read::kOverrun;
    SharedBytes<T>::give(words, value);
    return Read::kGot;
  }

  // Position of the entry to be written next.
  [[nodiscard]] std::uint64_t next() const noexcept { return next_.load(std::memory_order_acquire); }
  [[nodiscard]] static constexpr std::size_t capacity() noexcept { return Capacity; }

 private:
  alignas(64) std::atomic<std::uint64_t> next_{0};
  std::atomic<std::uint64_t> begun_{0}, first_{0};
  alignas(64) std::array<SharedBytes<T>, Capacity> slots_{};
};

// The newest value from one writer to any readers, in one process or between processes (sequence lock). If
// the writer is killed during a write, readers keep the value they had, and the next writer continues.
template <typename T>
class SharedRecord {
 public:
  SharedRecord() = default;
  SharedRecord(const SharedRecord&) = delete;
  SharedRecord& operator=(const SharedRecord&) = delete;

  void write(const T& value) noexcept {
    const std::uint64_t odd = version_.load(std::memory_order_relaxed) | 1U;
    version_.store(odd, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    value_.store(value);
    version_.store(odd + 1, std::memory_order_release);
  }
  // False, and `value` untouched, if nothing was ever written or every try met a write in progress.
  [[nodiscard]] bool read(T& value) const noexcept {
    constexpr int kTries = 16;
    for (int i = 0; i < kTries; ++i) {
      const std::uint64_t before = version_.load(std::memory_order_acquire);
      if (before == 0) return false;
      if ((before & 1U) != 0) continue;
      typename SharedBytes<T>::Words words;
      value_.load(words);
      std::atomic_thread_fence(std::memory_order_acquire);
      if (version_.load(std::memory_order_relaxed) != before) continue;
      SharedBytes<T>::give(words, value);
      return true;
    }
    return false;
  }
  [[nodiscard]] std::uint64_t version() const noexcept { return version_.load(std::memory_order_acquire); }

 private:
  std::atomic<std::uint64_t> version_{0};  // odd: being written
  SharedBytes<T> value_;
};

}  // namespace fathom::rt

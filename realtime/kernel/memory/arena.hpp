#pragma once

#include <cstddef>
#include <cstdint>
#include <new>
#include <span>
#include <type_traits>

namespace fathom::rt {

enum class MemoryLock : std::uint8_t { kUnlocked, kLocked };

// Bump allocator over one block taken from the system at construction, with every page already touched (and,
// when asked, locked), so that later use neither faults nor grows the resident set. Memory is given back only
// with the arena. For one thread at a time.
//
// When it is full, allocate() returns nullptr and counts the refusal; nothing else changes.
class Arena {
 public:
  // `bytes` is rounded up to whole pages. Throws std::system_error when the system refuses the memory or the
  // lock (set-up only; the lock needs CAP_IPC_LOCK or a high enough RLIMIT_MEMLOCK).
  explicit Arena(std::size_t bytes, MemoryLock lock = MemoryLock::kUnlocked);
  ~Arena();
  Arena(const Arena&) = delete;
  Arena& operator=(const Arena&) = delete;

  // `alignment` is a power of two. nullptr when the rest of the block is too small.
  [[nodiscard]] void* allocate(std::size_t bytes, std::size_t alignment = alignof(std::max_align_t)) noexcept;

  // `count` value-initialised objects; an empty span when they do not fit. Their destructors never run.
  template <typename T>
  [[nodiscard]] std::span<T> allocateArray(std::size_t count) noexcept {
    static_assert(std::is_trivially_destructible_v<T>);
    if (count > capacity_ / sizeof(T)) {
      ++refused_;
      return {};
    }
    void* memory = allocate(count * sizeof(T), alignof(T));
    if (memory == nullptr) return {};
    T* first = static_cast<T*>(memory);
    for (std::size_t i = 0; i < count; ++i) ::new (static_cast<void*>(first + i)) T();
    return {first, count};
  }

  [[nodiscard]] std::size_t capacity() const noexcept { return capacity_; }  // [bytes]
  [[nodiscard]] std::size_t used() const noexcept { return used_; }          // [bytes], padding included
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_; }

 private:
  std::byte* block_ = nullptr;
  std::size_t capacity_ = 0;
  std::size_t used_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace fathom::rt

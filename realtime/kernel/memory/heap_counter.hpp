#pragma once

#include <cstdint>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define FATHOM_SANITIZED 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define FATHOM_SANITIZED 1
#endif

namespace fathom::rt {

// Heap calls and page faults of a thread so far. A program that links fathom_heap_counter counts malloc,
// calloc, realloc, free and the aligned forms, and with them operator new and delete, in every library of the
// process. Under a sanitizer its own allocator hooks count (allocations and frees).
struct ThreadCost {
  std::uint64_t heap_calls = 0;    // allocations and frees (a free of nullptr is none)
  std::uint64_t minor_faults = 0;  // page faults without input or output
  std::uint64_t major_faults = 0;  // page faults that read a device

  ThreadCost operator-(const ThreadCost& before) const {
    return {heap_calls - before.heap_calls, minor_faults - before.minor_faults,
            major_faults - before.major_faults};
  }
};

// Totals of the calling thread since it began; take the difference of two. Allocates nothing itself.
[[nodiscard]] ThreadCost threadCost() noexcept;

// True when a sanitizer runs in this process: its shadow memory faults, so that page faults are meaningless.
[[nodiscard]] constexpr bool sanitized() noexcept {
#ifdef FATHOM_SANITIZED
  return true;
#else
  return false;
#endif
}

}  // namespace fathom::rt

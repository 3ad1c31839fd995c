#include "realtime/kernel/memory/heap_counter.hpp"

#include <sys/resource.h>

#include <cerrno>
#include <cstddef>

namespace {
// Static storage of the program itself: no allocation on a thread's first use.
thread_local std::uint64_t heap_calls = 0;
}  // namespace

namespace fathom::rt {

ThreadCost threadCost() noexcept {
  rusage usage{};
  ::getrusage(RUSAGE_THREAD, &usage);
  return {heap_calls, static_cast<std::uint64_t>(usage.ru_minflt),
          static_cast<std::uint64_t>(usage.ru_majflt)};
}

}  // namespace fathom::rt

#ifdef FATHOM_SANITIZED

// The sanitizers' public interface (sanitizer/allocator_interface.h), which GCC 12 implements without its
// header.
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*malloc_hook)(const volatile void*,
                                                                             std::size_t),
                                                         void (*free_hook)(const volatile void*));

namespace {
[[maybe_unused]] const int installed =
    __sanitizer_install_malloc_and_free_hooks([](const volatile void*, std::size_t) { ++heap_calls; },
                                              [](const volatile void* memory) {
                                                if (memory != nullptr) ++heap_calls;
                                              });
}  // namespace

#else

// glibc lets a program replace its allocator by defining these names, and keeps its own under __libc_*.
extern "C" {

// NOLINTBEGIN(bugprone-reserved-identifier)
void* __libc_malloc(std::size_t bytes);
void* __libc_calloc(std::size_t count, std::size_t bytes);
void* __libc_realloc(void* memory, std::size_t bytes);
void* __libc_memalign(std::size_t alignment, std::size_t bytes);
void __libc_free(void* memory);
// NOLINTEND(bugprone-reserved-identifier)

void* malloc(std::size_t bytes) {
  ++heap_calls;
  return __libc_malloc(bytes);
}
void* calloc(std::size_t count, std::size_t bytes) {
  ++heap_calls;
  return __libc_calloc(count, bytes);
}
void* realloc(void* memory, std::size_t bytes) {
  ++heap_calls;
  return __libc_realloc(memory, bytes);
}
void* memalign(std::size_t alignment, std::size_t bytes) {
  ++heap_calls;
  return __libc_memalign(alignment, bytes);
}
void* aligned_alloc(std::size_t alignment, std::size_t bytes) {
  ++heap_calls;
  return __libc_memalign(alignment, bytes);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t bytes) {
  ++heap_calls;
  if (alignment % sizeof(void*) != 0 || alignment == 0 || (alignment & (alignment - 1)) != 0) return EINVAL;
  void* made = __libc_memalign(alignment, bytes);
  if (made == nullptr) return ENOMEM;
  *memory = made;
  return 0;
}
void free(void* memory) {
  if (memory != nullptr) ++heap_calls;
  __libc_free(memory);
}

}  // extern "C"

#endif

#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "realtime/base/config_keys.hpp"

namespace fathom::rt {

// `[memory]` of a program's configuration; README.md of the kernel lists the keys.
struct MemoryConfig {
  std::size_t budget_bytes = std::size_t{768} << 20;       // of the whole program
  std::size_t heap_bytes = std::size_t{72} << 20;          // for what libraries and the soft tier allocate
  std::size_t vehicle_heap_bytes = std::size_t{20} << 20;  // of the vehicle process, for devices and reports
};

// Its keys; the heap is smaller than the budget.
void visitMemory(KeyVisitor& keys, MemoryConfig& config);

// The C heap as a pool of fixed size, for libraries that allocate (OpenCV's buffers, LCM, GLib): one heap for
// all threads, taken whole from the system and touched; nothing is given back or mapped beside it. While the
// memory in use fits, the resident set neither grows nor shrinks, and nothing faults. Excess grows the heap
// and is visible in overflowBytes().
//
// One heap means one lock: threads that allocate wait for one another. The hard tier allocates nothing.
class HeapReserve {
 public:
  // First call in main, before any thread runs: one heap, no mapped blocks, nothing given back.
  static bool takeOverAllocator() noexcept;

  // Call once, when everything that lives as long as the program is allocated: grows the heap by `bytes` of
  // touched memory. False when the system refuses.
  [[nodiscard]] bool reserve(std::size_t bytes) noexcept;

  // Of the whole heap, now [bytes]; takes the heap's lock, not for the hard tier.
  [[nodiscard]] static std::size_t usedBytes() noexcept;
  [[nodiscard]] static std::size_t heapBytes() noexcept;
  // In use beyond what was in use when the reserve was made [bytes].
  [[nodiscard]] std::size_t usedOfReserve() const noexcept;
  // By how much the heap has grown since the reserve was made [bytes]: 0 unless the reserve was too small.
  [[nodiscard]] std::size_t overflowBytes() const noexcept;

 private:
  std::size_t used_before_ = 0, heap_then_ = 0;
};

}  // namespace fathom::rt

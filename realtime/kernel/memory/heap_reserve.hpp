#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "realtime/kernel/config_table.hpp"

namespace fathom::rt {

// `[memory]` of a program's configuration; README.md of the kernel lists the keys.
struct MemoryConfig {
  std::size_t budget_bytes = std::size_t{768} << 20;  // of the whole program
  std::size_t heap_bytes = std::size_t{72} << 20;     // for what libraries and the soft tier allocate
};

// Throws InputError for a value out of range or a heap larger than the budget.
[[nodiscard]] MemoryConfig readMemoryConfig(const ConfigTable& table, MemoryConfig defaults = {});

// The C heap as a pool of fixed size, for code that allocates whatever we do (OpenCV's internal buffers,
// LCM, GLib): one heap for all threads, taken whole from the system and touched, from which nothing is given
// back and beside which nothing is mapped. As long as what is in use at once fits, the resident set neither
// grows nor shrinks, and nothing faults. What does not fit grows the heap and is seen in overflowBytes().
//
// One heap means one lock: threads that allocate wait for one another. The hard tier allocates nothing.
class HeapReserve {
 public:
  // First thing in main, before any thread runs: one heap, no mapped blocks, nothing given back.
  static bool takeOverAllocator() noexcept;

  // Once, when everything that lives as long as the program has been allocated: grows the heap by `bytes` of
  // touched memory. False when the system has not so much.
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

// Read-only data of a library of at least this size is a table (character sets, projections) of which the
// program reads little or nothing: it is left out of what is locked, counted and made resident.
inline constexpr std::size_t kBulkDataBytes = std::size_t{16} << 20;

// Unlocks such data and gives its pages back; what is read of it comes back from the disk. After mlockall().
void leaveBulkData() noexcept;

// Makes every page that this process has mapped resident, as mlockall(MCL_CURRENT) does, where locking is
// refused: program text and library data too, which would otherwise be read when first used. Gives the bytes
// that could not be.
std::size_t populateMappings() noexcept;

}  // namespace fathom::rt

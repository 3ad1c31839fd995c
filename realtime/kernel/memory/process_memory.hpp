#pragma once

#include <cstddef>
#include <cstdint>

namespace fathom::rt {

struct ProcessFigures {
  std::size_t resident = 0;                          // [bytes] of the whole process, as the next three sum up
  std::size_t resident_private = 0;                  // [bytes] heap, stacks, pools
  std::size_t resident_files = 0;                    // [bytes] the program and its libraries
  std::size_t resident_shared = 0;                   // [bytes]
  std::size_t highest_resident = 0;                  // [bytes]
  std::size_t locked = 0;                            // [bytes]
  std::uint64_t minor_faults = 0, major_faults = 0;  // of all threads since the program began
};

// The system's figures about this process. Opens its file once; read() takes no heap and may be called at any
// rate of a best-effort tier (some 20 us). One thread.
class ProcessMemory {
 public:
  ProcessMemory() noexcept;
  ~ProcessMemory();
  ProcessMemory(const ProcessMemory&) = delete;
  ProcessMemory& operator=(const ProcessMemory&) = delete;

  // False, and `figures` untouched, where /proc gives nothing.
  [[nodiscard]] bool read(ProcessFigures& figures) noexcept;

 private:
  int status_ = -1;
};

// Resident bytes counted page by page (/proc/self/smaps_rollup): exact but slow; the kernel's counters, one
// per CPU, lag by some tens of pages. 0 where the system gives none.
[[nodiscard]] std::size_t exactResidentBytes() noexcept;

// Size of the program and its libraries once all their pages are resident, as locking makes them [bytes]. 0
// where the system gives none.
[[nodiscard]] std::size_t mappedFileBytes() noexcept;
// Private memory, heap and stacks, once all of it is locked, touched or not [bytes].
[[nodiscard]] std::size_t mappedPrivateBytes() noexcept;
// Part of the files' pages that is private to this process: writable data and relocations [bytes]. Processes
// of the same program share the rest.
[[nodiscard]] std::size_t privateFileBytes() noexcept;

// Read-only library data of at least this size is a table (character sets, projections) that the program
// hardly reads: it is neither locked, nor counted, nor made resident.
inline constexpr std::size_t kBulkDataBytes = std::size_t{16} << 20;

// Unlocks such data and releases its pages, which are read from the disk when needed. Call after mlockall().
void leaveBulkData() noexcept;

// Makes every mapped page of this process resident, as mlockall(MCL_CURRENT) does, where locking is refused:
// program text and library data, too, which would otherwise fault at first use. Returns the bytes that could
// not be.
std::size_t populateMappings() noexcept;

}  // namespace fathom::rt

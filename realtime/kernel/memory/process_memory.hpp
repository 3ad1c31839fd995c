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

  // False, and `figures` untouched, where /proc does not tell.
  [[nodiscard]] bool read(ProcessFigures& figures) noexcept;

 private:
  int status_ = -1;
};

// Resident bytes counted page by page (/proc/self/smaps_rollup): exact where the counters that the kernel
// keeps a CPU each lag behind by some tens of pages, and slow. 0 where the system does not tell.
[[nodiscard]] std::size_t exactResidentBytes() noexcept;

// What the program and its libraries take once every page of them is resident, as locked memory makes them
// [bytes]. For the budget; 0 where the system does not tell.
[[nodiscard]] std::size_t mappedFileBytes() noexcept;
// Of memory that is the program's own, heap and stacks: what it takes once all of it is locked, touched or
// not.
[[nodiscard]] std::size_t mappedPrivateBytes() noexcept;
// Of the files' pages, those that this process has for itself: data that it may write, and what was
// relocated. Other processes of the same program share the rest.
[[nodiscard]] std::size_t privateFileBytes() noexcept;

}  // namespace fathom::rt

#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

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

struct PoolUse {
  std::size_t used = 0;        // [bytes]
  std::size_t high_water = 0;  // [bytes]
  std::uint64_t refused = 0;   // requests while it was full
};

// Figures of a pool: written by one thread, read by any.
class PoolGauge {
 public:
  // By the pool's owner.
  void set(std::size_t used_bytes, std::uint64_t refused = 0) noexcept {
    used_.store(used_bytes, std::memory_order_relaxed);
    if (used_bytes > high_water_.load(std::memory_order_relaxed))
      high_water_.store(used_bytes, std::memory_order_relaxed);
    refused_.store(refused, std::memory_order_relaxed);
  }
  void set(const PoolUse& use) noexcept {
    used_.store(use.used, std::memory_order_relaxed);
    high_water_.store(use.high_water, std::memory_order_relaxed);
    refused_.store(use.refused, std::memory_order_relaxed);
  }
  [[nodiscard]] PoolUse read() const noexcept {
    return {used_.load(std::memory_order_relaxed), high_water_.load(std::memory_order_relaxed),
            refused_.load(std::memory_order_relaxed)};
  }

 private:
  std::atomic<std::size_t> used_{0}, high_water_{0};
  std::atomic<std::uint64_t> refused_{0};
};

// Every pool of the program by name, with the bytes that the configuration plans for it, against one total.
// Filled at set-up; read() allocates nothing afterwards.
class MemoryBudget {
 public:
  explicit MemoryBudget(std::size_t budget_bytes) : budget_bytes_(budget_bytes) {}
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  // A pool with a gauge that its owner writes; the reference is valid as long as the budget. Until it is
  // written the table shows the plan alone.
  PoolGauge& add(std::string name, std::size_t planned_bytes);
  // A pool that reports its use when asked, from any thread: rings and shared blocks.
  void add(std::string name, std::size_t planned_bytes, std::function<PoolUse()> ask);
  // Memory taken as a whole: stacks, the program's own pages. Its use equals its plan.
  void addFixed(std::string name, std::size_t planned_bytes);

  struct Row {
    const char* name = "";
    std::size_t planned = 0;  // [bytes]
    bool measured = false;    // `use` says something
    PoolUse use;
  };
  [[nodiscard]] std::size_t pools() const noexcept { return pools_.size(); }
  [[nodiscard]] Row read(std::size_t pool) const;

  [[nodiscard]] std::size_t budgetBytes() const noexcept { return budget_bytes_; }
  [[nodiscard]] std::size_t plannedBytes() const noexcept;
  [[nodiscard]] bool fits() const noexcept { return plannedBytes() <= budget_bytes_; }

  // A line for each pool, the largest plan first, and the total; with `measured`, in use, high water and
  // refusals beside it.
  [[nodiscard]] std::string table(bool measured) const;

 private:
  struct Pool {
    std::string name;
    std::size_t planned = 0;
    bool fixed = false;
    std::function<PoolUse()> ask;
    PoolGauge gauge;
  };
  std::size_t budget_bytes_;
  std::deque<Pool> pools_;  // a gauge stays where it is while pools are added
};

}  // namespace fathom::rt

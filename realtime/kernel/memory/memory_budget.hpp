#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

namespace fathom::rt {

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

#include "realtime/kernel/memory/memory_budget.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::rt {

PoolGauge& MemoryBudget::add(std::string name, std::size_t planned_bytes) {
  Pool& pool = pools_.emplace_back();
  pool.name = std::move(name);
  pool.planned = planned_bytes;
  return pool.gauge;
}

void MemoryBudget::add(std::string name, std::size_t planned_bytes, std::function<PoolUse()> ask) {
  add(std::move(name), planned_bytes);
  pools_.back().ask = std::move(ask);
}

void MemoryBudget::addFixed(std::string name, std::size_t planned_bytes) {
  add(std::move(name), planned_bytes);
  pools_.back().fixed = true;
}

MemoryBudget::Row MemoryBudget::read(std::size_t index) const {
  const Pool& pool = pools_.at(index);
  Row row{pool.name.c_str(), pool.planned, true, {}};
  if (pool.fixed) {
    row.use = {pool.planned, pool.planned, 0};
  } else if (pool.ask) {
    row.use = pool.ask();
  } else {
    row.use = pool.gauge.read();
    row.measured = row.use.high_water > 0 || row.use.refused > 0;
  }
  return row;
}

std::size_t MemoryBudget::plannedBytes() const noexcept {
  return std::accumulate(pools_.begin(), pools_.end(), std::size_t{0},
                         [](std::size_t sum, const Pool& pool) { return sum + pool.planned; });
}

std::string MemoryBudget::table(bool measured) const {
  std::vector<std::size_t> order(pools_.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return pools_[a].planned > pools_[b].planned; });

  std::string text = formatted("%-34s %12s", "pool", "planned MiB");
  if (measured) text += formatted(" %12s %12s %10s", "in use MiB", "highest MiB", "refused");
  text += '\n';
  for (const std::size_t index : order) {
    const Row row = read(index);
    text += formatted("%-34s %12.2f", row.name, mebibytes(row.planned));
    if (measured && row.measured)
      text += formatted(" %12.2f %12.2f %10llu", mebibytes(row.use.used), mebibytes(row.use.high_water),
                        static_cast<unsigned long long>(row.use.refused));
    text += '\n';
  }
  text += formatted("%-34s %12.2f of %.2f MiB, %s\n", "total", mebibytes(plannedBytes()),
                    mebibytes(budget_bytes_), fits() ? "fits" : "does not fit");
  return text;
}

}  // namespace fathom::rt

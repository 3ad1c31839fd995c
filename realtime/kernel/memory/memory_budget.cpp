#include "realtime/kernel/memory/memory_budget.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <numeric>
#include <string_view>
#include <utility>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::rt {
namespace {

constexpr std::size_t kStatusBytes = 4096;  // /proc/self/status has some 1.5 kB

// The number behind "Key:" in a text of lines "Key:   123 kB", in bytes; 0 where it is missing.
std::size_t kilobytes(std::string_view text, std::string_view key) noexcept {
  std::size_t at = text.find(key);
  while (at != std::string_view::npos && at != 0 && text[at - 1] != '\n') at = text.find(key, at + 1);
  if (at == std::string_view::npos) return 0;
  at = text.find_first_of("0123456789", at + key.size());
  if (at == std::string_view::npos) return 0;
  std::size_t value = 0;
  std::from_chars(text.data() + at, text.data() + text.size(), value);
  return value * 1024;
}

struct Mapping {
  unsigned long begin = 0, end = 0, inode = 0;  // inode 0: memory without a file
  char rights[5] = {};                          // as "r-xp"

  [[nodiscard]] std::size_t bytes() const noexcept { return end - begin; }
  [[nodiscard]] void* address() const noexcept { return reinterpret_cast<void*>(begin); }  // NOLINT
  [[nodiscard]] bool has(const char* all_rights) const noexcept {
    return std::strcmp(rights, all_rights) == 0;
  }
  [[nodiscard]] bool bulkData() const noexcept { return has("r--p") && bytes() >= kBulkDataBytes; }
};

// Calls visit(line, mapping) for every line of /proc/self/maps or smaps; `mapping` is null for the lines of
// smaps that do not begin one.
template <typename Visit>
void eachLine(const char* file, const Visit& visit) noexcept {
  std::FILE* maps = std::fopen(file, "re");
  if (maps == nullptr) return;
  char line[512];
  while (std::fgets(line, sizeof line, maps) != nullptr) {
    Mapping m;
    const bool begins =
        std::sscanf(line, "%lx-%lx %4s %*x %*s %lu", &m.begin, &m.end, m.rights, &m.inode) == 4;
    visit(line, begins ? &m : nullptr);
  }
  std::fclose(maps);
}

}  // namespace

ProcessMemory::ProcessMemory() noexcept : status_(::open("/proc/self/status", O_RDONLY | O_CLOEXEC)) {}
ProcessMemory::~ProcessMemory() {
  if (status_ >= 0) ::close(status_);
}

bool ProcessMemory::read(ProcessFigures& figures) noexcept {
  char buffer[kStatusBytes];
  const ssize_t bytes = status_ < 0 ? -1 : ::pread(status_, buffer, sizeof buffer, 0);
  if (bytes <= 0) return false;
  const std::string_view text(buffer, static_cast<std::size_t>(bytes));
  figures.resident = kilobytes(text, "VmRSS:");
  figures.resident_private = kilobytes(text, "RssAnon:");
  figures.resident_files = kilobytes(text, "RssFile:");
  figures.resident_shared = kilobytes(text, "RssShmem:");
  figures.highest_resident = kilobytes(text, "VmHWM:");
  figures.locked = kilobytes(text, "VmLck:");
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  figures.minor_faults = static_cast<std::uint64_t>(usage.ru_minflt);
  figures.major_faults = static_cast<std::uint64_t>(usage.ru_majflt);
  return true;
}

std::size_t exactResidentBytes() noexcept {
  const int file = ::open("/proc/self/smaps_rollup", O_RDONLY | O_CLOEXEC);
  if (file < 0) return 0;
  char buffer[kStatusBytes];
  const ssize_t bytes = ::pread(file, buffer, sizeof buffer, 0);
  ::close(file);
  return bytes <= 0 ? 0 : kilobytes({buffer, static_cast<std::size_t>(bytes)}, "Rss:");
}

std::size_t mappedPrivateBytes() noexcept {
  std::size_t total = 0;
  eachLine("/proc/self/maps", [&](const char*, const Mapping* m) noexcept {
    if (m != nullptr && m->inode == 0 && m->has("rw-p")) total += m->bytes();
  });
  return total;
}

std::size_t mappedFileBytes() noexcept {
  std::size_t total = 0;
  // A page without any right is never resident; memory without a name that processes share is a pool's.
  eachLine("/proc/self/maps", [&](const char*, const Mapping* m) noexcept {
    if (m != nullptr && m->inode != 0 && m->rights[0] == 'r' && m->rights[3] == 'p' && !m->bulkData())
      total += m->bytes();
  });
  return total;
}

std::size_t privateFileBytes() noexcept {
  std::size_t total = 0;
  bool of_file = false;
  eachLine("/proc/self/smaps", [&](const char* line, const Mapping* m) noexcept {
    unsigned long anonymous = 0;
    if (m != nullptr) {
      of_file = m->inode != 0 && m->rights[3] == 'p' && !m->has("rw-p");
      if (m->inode != 0 && m->has("rw-p")) total += m->bytes();
    } else if (of_file && std::sscanf(line, "Anonymous: %lu kB", &anonymous) == 1) {
      total += anonymous * 1024;
    }
  });
  return total;
}

void leaveBulkData() noexcept {
  eachLine("/proc/self/maps", [](const char*, const Mapping* m) noexcept {
    if (m == nullptr || m->inode == 0 || !m->bulkData()) return;
    (void)::munlock(m->address(), m->bytes());
    (void)::madvise(m->address(), m->bytes(), MADV_DONTNEED);
  });
}

std::size_t populateMappings() noexcept {
  std::size_t refused = 0;
  eachLine("/proc/self/maps", [&](const char* line, const Mapping* m) noexcept {
    if (m == nullptr || m->rights[0] != 'r' || m->bulkData()) return;
    // The kernel's own pages, the growing stack of main and what is shared with others stay as they are.
    if (std::strstr(line, "[v") != nullptr || std::strstr(line, "[stack]") != nullptr || m->rights[3] == 's')
      return;
    const int advice = m->rights[1] == 'w' ? MADV_POPULATE_WRITE : MADV_POPULATE_READ;
    if (::madvise(m->address(), m->bytes(), advice) != 0) refused += m->bytes();
  });
  return refused;
}

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

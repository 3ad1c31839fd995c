#include "realtime/kernel/memory/heap_reserve.hpp"

#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>

#include <climits>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace fathom::rt {
namespace {

constexpr std::int64_t kMib = std::int64_t{1} << 20;
constexpr std::int64_t kMaxMib = 65536;
// The heap grows by whole steps, so that a small overflow does not become a system call for each allocation.
constexpr int kGrowBytes = 1 << 20;

}  // namespace

MemoryConfig readMemoryConfig(const ConfigTable& table, MemoryConfig defaults) {
  const auto mib = [&](const char* key, std::size_t fallback, std::int64_t min) {
    return static_cast<std::size_t>(
        table.integer(key, static_cast<std::int64_t>(fallback) / kMib, min, kMaxMib) * kMib);
  };
  MemoryConfig config;
  config.budget_bytes = mib("budget_mib", defaults.budget_bytes, 16);
  config.heap_bytes = mib("heap_mib", defaults.heap_bytes, 0);
  if (config.heap_bytes >= config.budget_bytes) table.fail("heap_mib", "must be less than budget_mib");
  return config;
}

bool HeapReserve::takeOverAllocator() noexcept {
  return ::mallopt(M_ARENA_MAX, 1) == 1 && ::mallopt(M_MMAP_MAX, 0) == 1 &&
         ::mallopt(M_TRIM_THRESHOLD, INT_MAX) == 1 && ::mallopt(M_TOP_PAD, kGrowBytes) == 1;
}

bool HeapReserve::reserve(std::size_t bytes) noexcept {
  used_before_ = usedBytes();
  // What is free already, in whatever pieces, is part of the reserve.
  const std::size_t free_now = heapBytes() - used_before_;
  const std::size_t missing = bytes > free_now ? bytes - free_now : 0;
  if (missing > 0) {
    void* block = std::malloc(missing);
    if (block == nullptr) return false;
    // Volatile: the compiler would otherwise make a calloc of it, which touches nothing.
    const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
    for (std::size_t at = 0; at < missing; at += page) static_cast<volatile char*>(block)[at] = 0;
    std::free(block);
  }
  heap_then_ = heapBytes();
  return true;
}

std::size_t HeapReserve::usedBytes() noexcept {
  const auto info = ::mallinfo2();
  return info.uordblks + info.hblkhd;
}

std::size_t HeapReserve::heapBytes() noexcept {
  const auto info = ::mallinfo2();
  return info.arena + info.hblkhd;
}

std::size_t HeapReserve::usedOfReserve() const noexcept {
  const std::size_t used = usedBytes();
  return used > used_before_ ? used - used_before_ : 0;
}

std::size_t HeapReserve::overflowBytes() const noexcept {
  const std::size_t heap = heapBytes();
  return heap > heap_then_ ? heap - heap_then_ : 0;
}

void leaveBulkData() noexcept {
  std::FILE* maps = std::fopen("/proc/self/maps", "re");
  if (maps == nullptr) return;
  char line[512];
  while (std::fgets(line, sizeof line, maps) != nullptr) {
    unsigned long begin = 0, end = 0, inode = 0;
    char rights[5] = {};
    if (std::sscanf(line, "%lx-%lx %4s %*x %*s %lu", &begin, &end, rights, &inode) != 4) continue;
    if (inode == 0 || std::strcmp(rights, "r--p") != 0 || end - begin < kBulkDataBytes) continue;
    void* from = reinterpret_cast<void*>(begin);  // NOLINT: an address as /proc gives it
    (void)::munlock(from, end - begin);
    (void)::madvise(from, end - begin, MADV_DONTNEED);
  }
  std::fclose(maps);
}

std::size_t populateMappings() noexcept {
  std::FILE* maps = std::fopen("/proc/self/maps", "re");
  if (maps == nullptr) return 0;
  std::size_t refused = 0;
  char line[512];
  while (std::fgets(line, sizeof line, maps) != nullptr) {
    unsigned long begin = 0, end = 0;
    char rights[5] = {};
    if (std::sscanf(line, "%lx-%lx %4s", &begin, &end, rights) != 3 || rights[0] != 'r') continue;
    if (std::strcmp(rights, "r--p") == 0 && end - begin >= kBulkDataBytes) continue;
    // The kernel's own pages, the growing stack of main and what is shared with others stay as they are.
    if (std::strstr(line, "[v") != nullptr || std::strstr(line, "[stack]") != nullptr || rights[3] == 's')
      continue;
    const int advice = rights[1] == 'w' ? MADV_POPULATE_WRITE : MADV_POPULATE_READ;
    void* from = reinterpret_cast<void*>(begin);  // NOLINT: an address as /proc gives it
    if (::madvise(from, end - begin, advice) != 0) refused += end - begin;
  }
  std::fclose(maps);
  return refused;
}

}  // namespace fathom::rt

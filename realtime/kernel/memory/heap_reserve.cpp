#include "realtime/kernel/memory/heap_reserve.hpp"

#include <malloc.h>
#include <unistd.h>

#include <climits>
#include <cstdlib>

#include "realtime/base/units.hpp"

namespace fathom::rt {
namespace {

constexpr std::int64_t kMaxMib = 65536;
// The heap grows by whole steps, so that a small overflow does not become a system call for each allocation.
constexpr int kGrowBytes = kMebibyte;

}  // namespace

void visitMemory(KeyVisitor& keys, MemoryConfig& c) {
  constexpr auto kStep = static_cast<std::int64_t>(kMebibyte);
  keys.scaled("budget_mib", c.budget_bytes, kStep, "MiB", 16, kMaxMib,
              "of the whole program, all its processes and libraries included");
  keys.scaled("heap_mib", c.heap_bytes, kStep, "MiB", 0, kMaxMib,
              "for what libraries and the soft tier allocate; less than the budget");
  keys.scaled("vehicle_heap_mib", c.vehicle_heap_bytes, kStep, "MiB", 4, 4096,
              "for what devices and reports allocate in the vehicle process; heap_mib is the mapper's");
  keys.require(c.heap_bytes < c.budget_bytes, "heap_mib", "must be less than budget_mib");
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

}  // namespace fathom::rt

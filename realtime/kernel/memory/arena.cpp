#include "realtime/kernel/memory/arena.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include <cassert>
#include <cerrno>
#include <limits>
#include <string>
#include <system_error>

namespace fathom::rt {

Arena::Arena(std::size_t bytes, MemoryLock lock) {
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  if (bytes == 0 || bytes > std::numeric_limits<std::size_t>::max() - page)
    throw std::system_error(EINVAL, std::generic_category(), "arena of " + std::to_string(bytes) + " bytes");
  capacity_ = (bytes + page - 1) / page * page;
  void* memory = ::mmap(nullptr, capacity_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED)
    throw std::system_error(errno, std::generic_category(),
                            "arena: no memory for " + std::to_string(capacity_) + " bytes");
  block_ = static_cast<std::byte*>(memory);
  // Large pages: fewer faults now, fewer misses of the address tables later. Where there are none, so be it.
  (void)::madvise(block_, capacity_, MADV_HUGEPAGE);
  if (lock == MemoryLock::kLocked && ::mlock(block_, capacity_) != 0) {
    const int error = errno;
    ::munmap(block_, capacity_);
    throw std::system_error(error, std::generic_category(),
                            "arena: cannot lock " + std::to_string(capacity_) +
                                " bytes; raise RLIMIT_MEMLOCK or grant CAP_IPC_LOCK");
  }
  // A write to every page: a read alone would map the shared zero page and fault again on the first write.
  for (std::size_t offset = 0; offset < capacity_; offset += page)
    *static_cast<volatile std::byte*>(block_ + offset) = std::byte{0};
}

Arena::~Arena() {
  ::munmap(block_, capacity_);
}

void* Arena::allocate(std::size_t bytes, std::size_t alignment) noexcept {
  assert(alignment != 0 && (alignment & (alignment - 1)) == 0);
  // The block begins at a page, so alignment beyond a page is computed on the address, not on the offset.
  const auto base = reinterpret_cast<std::uintptr_t>(block_);
  const std::uintptr_t wanted =
      (base + used_ + alignment - 1) & ~(static_cast<std::uintptr_t>(alignment) - 1);
  const std::size_t begin = static_cast<std::size_t>(wanted - base);
  if (begin > capacity_ || bytes > capacity_ - begin) {
    ++refused_;
    return nullptr;
  }
  used_ = begin + bytes;
  return block_ + begin;
}

}  // namespace fathom::rt

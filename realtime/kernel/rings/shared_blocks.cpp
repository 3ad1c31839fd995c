#include "realtime/kernel/rings/shared_blocks.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cassert>
#include <cerrno>
#include <string>
#include <system_error>

#include "realtime/kernel/rings/spsc_ring.hpp"

namespace fathom::rt {
namespace {

std::size_t wholePages(std::size_t bytes) {
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  constexpr std::size_t kMost = std::size_t{1} << 42;
  if (bytes == 0 || bytes > kMost)
    throw std::system_error(EINVAL, std::generic_category(),
                            "shared memory of " + std::to_string(bytes) + " bytes");
  return (bytes + page - 1) / page * page;
}

constexpr std::size_t kMostBytes = std::size_t{1} << 40;  // no pool is meant to be larger

std::size_t strideOf(std::size_t blocks, std::size_t block_bytes) {
  if (blocks == 0 || block_bytes == 0 || blocks >= SharedBlocks::kNone || block_bytes > kMostBytes / blocks)
    throw std::system_error(
        EINVAL, std::generic_category(),
        "a pool of " + std::to_string(blocks) + " blocks of " + std::to_string(block_bytes) + " bytes");
  return (block_bytes + kCacheLine - 1) / kCacheLine * kCacheLine;
}

}  // namespace

SharedMemory::SharedMemory(std::size_t bytes)
    : file_(::memfd_create("fathom", MFD_CLOEXEC)), bytes_(wholePages(bytes)) {
  // Blocks taken at once: a machine without memory says so here and not by a signal later.
  const int failed = file_ < 0 ? errno : ::posix_fallocate(file_, 0, static_cast<off_t>(bytes_));
  if (failed != 0) {
    if (file_ >= 0) ::close(file_);
    throw std::system_error(failed, std::generic_category(),
                            "no shared memory for " + std::to_string(bytes_) + " bytes");
  }
  map(true);
}

SharedMemory::SharedMemory(int file, std::size_t bytes, bool writable)
    : file_(file), bytes_(wholePages(bytes)) {
  struct stat there {};
  if (::fstat(file_, &there) != 0 || static_cast<std::uint64_t>(there.st_size) < bytes_) {
    ::close(file_);
    throw std::system_error(EINVAL, std::generic_category(), "shared memory that is not there");
  }
  map(writable);
}

void SharedMemory::map(bool writable) {
  // Every page at once, so that nobody faults later.
  void* memory = ::mmap(nullptr, bytes_, writable ? PROT_READ | PROT_WRITE : PROT_READ,
                        MAP_SHARED | MAP_POPULATE, file_, 0);
  if (memory == MAP_FAILED) {
    const int error = errno;
    ::close(file_);
    throw std::system_error(error, std::generic_category(), "shared memory cannot be mapped");
  }
  data_ = static_cast<std::byte*>(memory);
}

SharedMemory::~SharedMemory() {
  ::munmap(data_, bytes_);
  ::close(file_);
}

SharedBlocks::SharedBlocks(std::size_t blocks, std::size_t block_bytes)
    : count_(blocks),
      block_bytes_(block_bytes),
      stride_(strideOf(blocks, block_bytes)),
      memory_(blocks * stride_),
      holders_(std::make_unique<std::atomic<std::uint32_t>[]>(blocks)) {}

std::uint32_t SharedBlocks::acquire() noexcept {
  for (std::size_t i = 0; i < count_; ++i) {
    const std::size_t block = (next_ + i) % count_;
    // Only this thread makes a free block held, so nobody comes between the look and the store. The look
    // sees all that the last holder did to the block.
    if (holders_[block].load(std::memory_order_acquire) != 0) continue;
    holders_[block].store(1, std::memory_order_relaxed);
    next_ = (block + 1) % count_;
    const std::size_t now = held();
    if (now > high_water_.load(std::memory_order_relaxed)) high_water_.store(now, std::memory_order_relaxed);
    return static_cast<std::uint32_t>(block);
  }
  refused_.fetch_add(1, std::memory_order_relaxed);
  return kNone;
}

void SharedBlocks::retain(std::uint32_t block) noexcept {
  assert(block < count_);
  [[maybe_unused]] const std::uint32_t before = holders_[block].fetch_add(1, std::memory_order_relaxed);
  assert(before > 0);
}

void SharedBlocks::release(std::uint32_t block) noexcept {
  assert(block < count_);
  [[maybe_unused]] const std::uint32_t before = holders_[block].fetch_sub(1, std::memory_order_acq_rel);
  assert(before > 0);
}

std::span<std::byte> SharedBlocks::bytes(std::uint32_t block) noexcept {
  assert(block < count_);
  return {memory_.data() + block * stride_, block_bytes_};
}

std::size_t SharedBlocks::held() const noexcept {
  std::size_t held = 0;
  for (std::size_t i = 0; i < count_; ++i) held += holders_[i].load(std::memory_order_relaxed) != 0;
  return held;
}

}  // namespace fathom::rt

#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace fathom::rt {

// Memory that other processes may map, too: a file without a name (memfd), every page touched. It exists as
// long as a process has it mapped or open.
class SharedMemory {
 public:
  // Throws std::system_error when the system refuses the memory. Zeros.
  explicit SharedMemory(std::size_t bytes);
  // The memory of an open file that another process made; writable only if `writable`. Throws
  // std::system_error, also where the file is shorter than `bytes`.
  SharedMemory(int file, std::size_t bytes, bool writable);
  ~SharedMemory();
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;

  [[nodiscard]] std::byte* data() const noexcept { return data_; }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  // File for another process to map; closed when a program is started, unless passed on.
  [[nodiscard]] int file() const noexcept { return file_; }

 private:
  void map(bool writable);

  int file_ = -1;
  std::size_t bytes_ = 0;  // whole pages
  std::byte* data_ = nullptr;
};

// A fixed number of equal blocks of pre-faulted memory with counted holders: camera frames, held by the
// recorder and by the map, which is another process that may map the memory. One thread acquires; any thread
// retains and releases; wait-free. When every block is held, acquire() returns kNone and counts the refusal.
class SharedBlocks {
 public:
  static constexpr std::uint32_t kNone = UINT32_MAX;

  // Throws std::system_error when the system refuses the memory.
  SharedBlocks(std::size_t blocks, std::size_t block_bytes);

  // A free block, now held once; or kNone. One thread only.
  [[nodiscard]] std::uint32_t acquire() noexcept;
  // Adds a holder; the caller must hold the block.
  void retain(std::uint32_t block) noexcept;
  // Removes a holder; the last one frees the block.
  void release(std::uint32_t block) noexcept;

  [[nodiscard]] std::span<std::byte> bytes(std::uint32_t block) noexcept;
  [[nodiscard]] std::size_t blocks() const noexcept { return count_; }
  // Where another process finds a block: block * stride() in the memory.
  [[nodiscard]] std::size_t stride() const noexcept { return stride_; }  // [bytes]
  [[nodiscard]] const SharedMemory& memory() const noexcept { return memory_; }
  [[nodiscard]] std::size_t blockBytes() const noexcept { return block_bytes_; }
  [[nodiscard]] std::size_t held() const noexcept;  // now
  [[nodiscard]] std::size_t highWater() const noexcept { return high_water_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

 private:
  std::size_t count_, block_bytes_;
  std::size_t stride_;  // from block to block: whole cache lines [bytes]
  SharedMemory memory_;
  std::unique_ptr<std::atomic<std::uint32_t>[]> holders_;
  std::size_t next_ = 0;  // where acquire() looks first
  std::atomic<std::size_t> high_water_{0};
  std::atomic<std::uint64_t> refused_{0};
};

}  // namespace fathom::rt

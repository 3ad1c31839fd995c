#pragma once

#include <cstddef>
#include <cstdint>

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

}  // namespace fathom::rt

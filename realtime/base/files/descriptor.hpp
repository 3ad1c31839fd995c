#pragma once

#include <fcntl.h>
#include <sys/file.h>
#include <sys/types.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

namespace fathom {

// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int file = -1) noexcept : file_(file) {}
  ~Descriptor() { reset(); }
  Descriptor(Descriptor&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    reset(std::exchange(other.file_, -1));
    return *this;
  }
  void reset(int file = -1) noexcept {
    if (file_ >= 0) ::close(file_);
    file_ = file;
  }
  [[nodiscard]] int get() const noexcept { return file_; }
  [[nodiscard]] bool open() const noexcept { return file_ >= 0; }

 private:
  int file_;
};

// Writes all bytes at an offset; returns how many were written before the disk refused (errno has the
// reason).
[[nodiscard]] inline std::size_t writeAt(int file, std::span<const std::uint8_t> bytes,
                                         std::uint64_t offset) noexcept {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t now =
        ::pwrite(file, bytes.data() + done, bytes.size() - done, static_cast<off_t>(offset + done));
    if (now < 0 && errno == EINTR) continue;
    if (now == 0) errno = ENOSPC;
    if (now <= 0) break;
    done += static_cast<std::size_t>(now);
  }
  return done;
}

// Fills `bytes` from an offset; false when the file ends before or the disk fails.
[[nodiscard]] inline bool readAt(int file, std::span<std::uint8_t> bytes, std::uint64_t offset) noexcept {
  while (!bytes.empty()) {
    const ssize_t now = ::pread(file, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (now < 0 && errno == EINTR) continue;
    if (now <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(now));
    offset += static_cast<std::uint64_t>(now);
  }
  return true;
}

// Flushes a file, or a folder's names, to the disk (fsync); false when it cannot be opened or the disk fails
// (errno).
[[nodiscard]] inline bool syncPath(const char* path) noexcept {
  const Descriptor file(::open(path, O_RDONLY | O_CLOEXEC));
  return file.open() && ::fsync(file.get()) == 0;
}

// True if another program holds the lock of an open file or folder; otherwise this program holds it until it
// closes the file. `kind`: LOCK_EX, or LOCK_SH (shared). A file system without locks reports no other holder.
[[nodiscard]] inline bool lockedElsewhere(int file, int kind = LOCK_EX) noexcept {
  return ::flock(file, kind | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

}  // namespace fathom

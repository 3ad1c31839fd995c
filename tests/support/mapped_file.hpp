#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "realtime/base/units.hpp"

namespace fathom::test {

// A `T` in a file that processes share; zeros where the file is new, of which a T must be able to begin.
template <class T>
class MappedFile {
 public:
  // Throws std::system_error.
  explicit MappedFile(const std::filesystem::path& path) {
    const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    void* memory = MAP_FAILED;
    if (file >= 0 && ::ftruncate(file, sizeof(T)) == 0)
      memory = ::mmap(nullptr, sizeof(T), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    const int error = errno;
    if (file >= 0) ::close(file);
    if (memory == MAP_FAILED) throw std::system_error(error, std::generic_category(), path.string());
    value_ = static_cast<T*>(memory);
  }
  ~MappedFile() { ::munmap(value_, sizeof(T)); }
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  T* operator->() const { return value_; }
  T& operator*() const { return *value_; }

 private:
  T* value_;
};

// The `T` in the file that an environment variable names; nullptr if it names none. Opens the file past the
// calls that a bad disk intercepts.
template <class T>
T* mappedByEnvironment(const char* variable) {
  const char* path = std::getenv(variable);
  if (path == nullptr) return nullptr;
  const long file = ::syscall(SYS_openat, AT_FDCWD, path, O_RDWR | O_CLOEXEC, 0);
  if (file < 0) return nullptr;
  void* memory = ::mmap(nullptr, sizeof(T), PROT_READ | PROT_WRITE, MAP_SHARED, static_cast<int>(file), 0);
  ::syscall(SYS_close, file);
  return memory == MAP_FAILED ? nullptr : static_cast<T*>(memory);
}

// A clock of the machine, for programs without the kernel's library [ns].
inline std::int64_t nowNs(clockid_t clock = CLOCK_MONOTONIC) {
  timespec now = {};
  ::clock_gettime(clock, &now);
  return now.tv_sec * kSecond_ns + now.tv_nsec;
}

}  // namespace fathom::test

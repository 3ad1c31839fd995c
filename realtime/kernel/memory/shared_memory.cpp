#include "realtime/kernel/memory/shared_memory.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>

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

}  // namespace fathom::rt

// A drive with a volatile write cache, put under the user-mode Linux: preloaded into linux.uml, it stands
// between the machine's loop device, which reaches the image through hostfs, and the image file. (The
// machine's own block device, ubd, passes no flush on to its file.) A write is acknowledged at once and may
// stay in the cache until the next flush; each 4 KiB of it reach the medium earlier with probability 1/2, so
// that a power cut leaves a random part of what was written since the last flush, as for a drive without
// power protection. Reads see the cache. Closing the image flushes.
//
// FATHOM_UML_DRIVE: the image. FATHOM_UML_DRIVE_SEED: of what reaches the medium early.

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <bitset>
#include <cstdarg>
#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace {

constexpr std::size_t kSector = 512;  // [bytes]
// What a drive writes whole or not at all, in sectors: 4 KiB, as drives of today do. ext4 relies on it for
// its superblock, which is 1 KiB.
constexpr std::size_t kAtomic = 8;
constexpr int kMaxFds = 1024;

class Drive {
 public:
  Drive() {
    const char* image = std::getenv("FATHOM_UML_DRIVE");
    const char* seed = std::getenv("FATHOM_UML_DRIVE_SEED");
    struct stat status = {};
    if (image == nullptr || ::stat(image, &status) != 0) return;
    device_ = status.st_dev;
    inode_ = status.st_ino;
    if (seed != nullptr) random_ = std::strtoull(seed, nullptr, 10);
    sectors_ = static_cast<std::size_t>(status.st_size) / kSector;
    cache_ = reserve(sectors_ * kSector);
    dirty_ = reserve(sectors_);
  }
  [[nodiscard]] bool has(int fd) const {
    return fd >= 0 && fd < kMaxFds && fds_[static_cast<std::size_t>(fd)];
  }

  void opened(int fd) {
    struct stat status = {};
    if (cache_ == nullptr || fd >= kMaxFds || ::fstat(fd, &status) != 0) return;
    if (status.st_dev == device_ && status.st_ino == inode_) fds_.set(static_cast<std::size_t>(fd));
  }
  void closing(int fd) {
    if (fds_.count() == 1) static_cast<void>(flush(fd));
    fds_.reset(static_cast<std::size_t>(fd));
  }

  [[nodiscard]] bool holds(std::size_t size, off_t offset) const {
    return offset >= 0 && offset % static_cast<off_t>(kSector) == 0 && size % kSector == 0 &&
           static_cast<std::size_t>(offset) + size <= sectors_ * kSector;
  }
  [[nodiscard]] ssize_t write(int fd, const void* data, std::size_t size, off_t offset) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    const std::size_t first = static_cast<std::size_t>(offset) / kSector;
    const std::size_t end = first + size / kSector;
    std::memcpy(cache_ + first * kSector, bytes, size);
    std::memset(dirty_ + first, 1, end - first);
    for (std::size_t begin = first; begin < end;) {
      const std::size_t unit_end = std::min(end, (begin / kAtomic + 1) * kAtomic);
      if (chance() && !destage(fd, begin, unit_end)) return -1;
      begin = unit_end;
    }
    return static_cast<ssize_t>(size);
  }
  void overlay(void* data, std::size_t size, off_t offset) const {
    auto* bytes = static_cast<unsigned char*>(data);
    const std::size_t first = static_cast<std::size_t>(offset) / kSector;
    for (std::size_t i = 0; i < size / kSector; ++i)
      if (dirty_[first + i] != 0) std::memcpy(bytes + i * kSector, cache_ + (first + i) * kSector, kSector);
  }
  [[nodiscard]] int flush(int fd) {
    for (std::size_t begin = 0; begin < sectors_;) {
      const auto* found = static_cast<const unsigned char*>(std::memchr(dirty_ + begin, 1, sectors_ - begin));
      if (found == nullptr) break;
      begin = static_cast<std::size_t>(found - dirty_);
      std::size_t end = begin;
      while (end < sectors_ && dirty_[end] != 0) ++end;
      if (!destage(fd, begin, end)) return -1;
      begin = end;
    }
    return 0;
  }

 private:
  static unsigned char* reserve(std::size_t bytes) {
    void* out =
        ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (out == MAP_FAILED) std::abort();
    return static_cast<unsigned char*>(out);
  }
  bool destage(int fd, std::size_t begin, std::size_t end) {
    const std::size_t size = (end - begin) * kSector;
    if (::syscall(SYS_pwrite64, fd, cache_ + begin * kSector, size, begin * kSector) !=
        static_cast<long>(size))
      return false;
    std::memset(dirty_ + begin, 0, end - begin);
    return true;
  }
  // SplitMix64 (Steele, Lea and Flood 2014).
  bool chance() {
    std::uint64_t z = random_ += 0x9E3779B97F4A7C15;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
    return ((z ^ (z >> 31)) & 1) != 0;
  }

  dev_t device_ = 0;
  ino_t inode_ = 0;
  std::uint64_t random_ = 0;
  std::bitset<kMaxFds> fds_;
  std::size_t sectors_ = 0;
  unsigned char* cache_ = nullptr;
  unsigned char* dirty_ = nullptr;  // a byte a sector: 1 where the cache is newer than the medium
};

Drive& drive() {
  static Drive instance;
  return instance;
}

}  // namespace

// The calls of linux.uml that reach its drive; all else passes.
extern "C" {

int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = (flags & (O_CREAT | __O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  const int fd = static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, flags, mode));
  if (fd >= 0) drive().opened(fd);
  return fd;
}

int close(int fd) {
  if (drive().has(fd)) drive().closing(fd);
  return static_cast<int>(::syscall(SYS_close, fd));
}

ssize_t pwrite64(int fd, const void* data, size_t size, off_t offset) {
  if (drive().has(fd) && drive().holds(size, offset)) return drive().write(fd, data, size, offset);
  return ::syscall(SYS_pwrite64, fd, data, size, offset);
}

ssize_t pread64(int fd, void* data, size_t size, off_t offset) {
  const ssize_t got = ::syscall(SYS_pread64, fd, data, size, offset);
  if (got == static_cast<ssize_t>(size) && drive().has(fd) && drive().holds(size, offset))
    drive().overlay(data, size, offset);
  return got;
}

int fdatasync(int fd) {
  return drive().has(fd) ? drive().flush(fd) : static_cast<int>(::syscall(SYS_fdatasync, fd));
}

int fsync(int fd) {
  return drive().has(fd) ? drive().flush(fd) : static_cast<int>(::syscall(SYS_fsync, fd));
}

}  // extern "C"

// The system's file calls, spoilt as a BadDiskControl says, and the program's fault points, as a
// BadPartsControl does: libfathom_bad_disk.so, preloaded into a program, or fathom_bad_disk_here, linked into
// a test. What the C library does inside of itself is out of reach: a FILE* is spoilt only as it is opened;
// copy_file_range() and mapped files are not spoilt either. The streams of C++ call read() and write(), and
// are.
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#include <stdexcept>

#include "realtime/base/units.hpp"
#include "realtime/kernel/fault_point.hpp"
#include "tests/support/bad_disk_control.hpp"
#include "tests/support/bad_parts.hpp"
#include "tests/support/mapped_file.hpp"

namespace {

using fathom::kSecond_ns, fathom::test::BadDiskControl, fathom::test::BadDiskRule, fathom::test::DiskFault;
using namespace fathom::test;  // the calls' names

constexpr std::size_t kMostPath = 4096;

std::atomic<BadDiskControl*> given{nullptr};

BadDiskControl* control() {
  if (BadDiskControl* here = given.load()) return here;
  static BadDiskControl* const of_environment = mappedByEnvironment<BadDiskControl>("FATHOM_BAD_DISK");
  return of_environment;
}

bool anyRule(const BadDiskControl* all) {
  if (all == nullptr) return false;
  for (const BadDiskRule& rule : all->rules)
    if (rule.fault != DiskFault::kNone) return true;
  return false;
}

// The next definition of a call: a sanitizer's, or the system's.
template <class Call>
Call next(const char* name) {
  return reinterpret_cast<Call>(::dlsym(RTLD_NEXT, name));
}

// "" when it is not known.
void pathOf(int fd, char* path) {
  char link[64];
  ::snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const ssize_t n = ::readlink(link, path, kMostPath - 1);
  path[n < 0 ? 0 : n] = 0;
}

void pathAt(int folder, const char* name, char* path) {
  if (name[0] == '/') {
    ::snprintf(path, kMostPath, "%s", name);
    return;
  }
  if (folder == AT_FDCWD) {
    if (::getcwd(path, kMostPath) == nullptr) path[0] = 0;
  } else {
    pathOf(folder, path);
  }
  const std::size_t size = ::strlen(path);
  ::snprintf(path + size, kMostPath - size, "/%s", name);
}

// Calls that a fault usually has.
std::uint32_t usualCalls(DiskFault fault) {
  constexpr std::uint32_t kChanges =
      kOpenCall | kWriteCall | kTruncateCall | kAllocateCall | kRenameCall | kUnlinkCall | kMakeFolderCall;
  switch (fault) {
    case DiskFault::kNoSpace:
      return kOpenCall | kWriteCall | kAllocateCall | kMakeFolderCall;
    case DiskFault::kReadOnly:
      return kChanges;
    case DiskFault::kShortWrite:
      return kWriteCall;
    case DiskFault::kNone:
    case DiskFault::kInputOutput:
    case DiskFault::kStall:
      break;
  }
  return kChanges | kReadCall | kSyncCall;
}

bool fits(const BadDiskRule& rule, DiskFault fault, const char* path, std::uint32_t call, int open_flags) {
  const std::uint32_t asked = rule.calls;
  if ((call & (asked != 0 ? asked : usualCalls(fault))) == 0) return false;
  if (rule.path[0] != 0 && ::strstr(path, rule.path) == nullptr) return false;
  if (call != kOpenCall || asked != 0) return true;
  // A full disk opens what is there, a read-only one opens for reading.
  const bool makes = (open_flags & O_CREAT) != 0 && ::syscall(SYS_faccessat, AT_FDCWD, path, F_OK) != 0;
  if (fault == DiskFault::kNoSpace) return makes;
  if (fault == DiskFault::kReadOnly) return makes || (open_flags & O_ACCMODE) != O_RDONLY;
  return true;
}

void sleepMs(std::uint32_t ms) {
  timespec left = {ms / 1000, static_cast<long>(ms % 1000) * 1'000'000};
  while (::nanosleep(&left, &left) != 0 && errno == EINTR) continue;
}

// What becomes of a call: 0, it is made; an errno; or kHalf.
constexpr int kHalf = -1;
int verdict(const char* path, std::uint32_t call, int open_flags = 0) {
  BadDiskControl* all = control();
  const std::size_t folder = ::strlen(all->folder);
  if (::strncmp(path, all->folder, folder) != 0 || (path[folder] != '/' && path[folder] != 0)) return 0;
  for (BadDiskRule& rule : all->rules) {
    const DiskFault fault = rule.fault;
    if (fault == DiskFault::kNone || !fits(rule, fault, path, call, open_flags)) continue;
    const std::uint64_t number = rule.seen++, after = rule.after, times = rule.times;
    const std::int64_t until = rule.until_ns;
    if (number < after || (times != 0 && number >= after + times) || (until != 0 && nowNs() > until))
      continue;
    const std::uint64_t hit = rule.hit++;
    switch (fault) {
      case DiskFault::kNone:
        break;
      case DiskFault::kNoSpace:
        return ENOSPC;
      case DiskFault::kReadOnly:
        return EROFS;
      case DiskFault::kInputOutput:
        return EIO;
      case DiskFault::kStall:
        sleepMs(rule.stall_ms);
        return 0;
      case DiskFault::kShortWrite:
        return hit == 0 ? kHalf : ENOSPC;
    }
  }
  return 0;
}

int verdictOf(int fd, std::uint32_t call) {
  if (!anyRule(control())) return 0;
  const int before = errno;
  char path[kMostPath];
  pathOf(fd, path);
  errno = before;
  return verdict(path, call);
}

int verdictAt(int folder, const char* name, std::uint32_t call, int open_flags = 0) {
  if (!anyRule(control())) return 0;
  const int before = errno;
  char path[kMostPath];
  pathAt(folder, name, path);
  const int spoilt = verdict(path, call, open_flags);
  errno = before;
  return spoilt;
}

template <class Result = int>
Result refuse(int error) {
  errno = error;
  return static_cast<Result>(-1);
}

int openAt(int folder, const char* name, int flags, mode_t mode) {
  static const auto call = next<int (*)(int, const char*, int, ...)>("openat");
  const int spoilt = verdictAt(folder, name, kOpenCall, flags);
  return spoilt != 0 ? refuse(spoilt) : call(folder, name, flags, mode);
}

mode_t modeOf(int flags, va_list arguments) {
  return (flags & (O_CREAT | __O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
}

// A part's faults, at its fault points (realtime/kernel/fault_point.hpp).
constexpr int kSlower = 10;

void sleepNs(std::int64_t ns) {
  timespec left = {ns / kSecond_ns, static_cast<long>(ns % kSecond_ns)};
  while (::nanosleep(&left, &left) != 0) continue;
}

void fail(PartFault fault) {
  switch (fault) {
    case PartFault::kThrow:
      throw std::runtime_error("a fault of a test");
    case PartFault::kAbort:
      ::abort();
    case PartFault::kSegmentation:
      ::raise(SIGSEGV);
      return;
    case PartFault::kKill:
      ::kill(::getpid(), SIGKILL);
      return;
    case PartFault::kHangShort:
      return sleepNs(kSecond_ns);
    case PartFault::kHang:
      for (;;) ::pause();
    case PartFault::kNone:
    case PartFault::kSlow:
    case PartFault::kCorrupt:
      return;
  }
}

}  // namespace

extern "C" {

void fathomBadDiskUse(fathom::test::BadDiskControl* control) {
  given = control;
}

#define FATHOM_OPEN(name)                         \
  int name(const char* path, int flags, ...) {    \
    va_list arguments;                            \
    va_start(arguments, flags);                   \
    const mode_t mode = modeOf(flags, arguments); \
    va_end(arguments);                            \
    return openAt(AT_FDCWD, path, flags, mode);   \
  }
#define FATHOM_OPENAT(name)                                \
  int name(int folder, const char* path, int flags, ...) { \
    va_list arguments;                                     \
    va_start(arguments, flags);                            \
    const mode_t mode = modeOf(flags, arguments);          \
    va_end(arguments);                                     \
    return openAt(folder, path, flags, mode);              \
  }
FATHOM_OPEN(open)
FATHOM_OPEN(open64)
FATHOM_OPENAT(openat)
FATHOM_OPENAT(openat64)
// What a program built with _FORTIFY_SOURCE calls.
int __open_2(const char* path, int flags) {
  return openAt(AT_FDCWD, path, flags, 0);
}
int __open64_2(const char* path, int flags) {
  return openAt(AT_FDCWD, path, flags, 0);
}
int __openat_2(int folder, const char* path, int flags) {
  return openAt(folder, path, flags, 0);
}
int __openat64_2(int folder, const char* path, int flags) {
  return openAt(folder, path, flags, 0);
}

#define FATHOM_FOPEN(name)                                                                            \
  FILE* name(const char* path, const char* mode) {                                                    \
    static const auto call = next<FILE* (*)(const char*, const char*)>(#name);                        \
    const int access = strchr(mode, '+') ? O_RDWR : mode[0] == 'r' ? O_RDONLY : O_WRONLY;             \
    const int spoilt = verdictAt(AT_FDCWD, path, kOpenCall, access | (mode[0] == 'r' ? 0 : O_CREAT)); \
    if (spoilt == 0) return call(path, mode);                                                         \
    errno = spoilt;                                                                                   \
    return nullptr;                                                                                   \
  }
FATHOM_FOPEN(fopen)
FATHOM_FOPEN(fopen64)

ssize_t read(int fd, void* to, size_t size) {
  static const auto call = next<ssize_t (*)(int, void*, size_t)>("read");
  const int spoilt = verdictOf(fd, kReadCall);
  return spoilt != 0 ? refuse<ssize_t>(spoilt) : call(fd, to, size);
}
#define FATHOM_PREAD(name)                                                        \
  ssize_t name(int fd, void* to, size_t size, off_t at) {                         \
    static const auto call = next<ssize_t (*)(int, void*, size_t, off_t)>(#name); \
    const int spoilt = verdictOf(fd, kReadCall);                                  \
    return spoilt != 0 ? refuse<ssize_t>(spoilt) : call(fd, to, size, at);        \
  }
FATHOM_PREAD(pread)
FATHOM_PREAD(pread64)

ssize_t write(int fd, const void* from, size_t size) {
  static const auto call = next<ssize_t (*)(int, const void*, size_t)>("write");
  const int spoilt = verdictOf(fd, kWriteCall);
  if (spoilt == kHalf) return call(fd, from, (size + 1) / 2);
  return spoilt != 0 ? refuse<ssize_t>(spoilt) : call(fd, from, size);
}
#define FATHOM_PWRITE(name)                                                             \
  ssize_t name(int fd, const void* from, size_t size, off_t at) {                       \
    static const auto call = next<ssize_t (*)(int, const void*, size_t, off_t)>(#name); \
    const int spoilt = verdictOf(fd, kWriteCall);                                       \
    if (spoilt == kHalf) return call(fd, from, (size + 1) / 2, at);                     \
    return spoilt != 0 ? refuse<ssize_t>(spoilt) : call(fd, from, size, at);            \
  }
FATHOM_PWRITE(pwrite)
FATHOM_PWRITE(pwrite64)
ssize_t writev(int fd, const iovec* from, int count) {
  static const auto call = next<ssize_t (*)(int, const iovec*, int)>("writev");
  const int spoilt = verdictOf(fd, kWriteCall);
  if (spoilt == kHalf) {
    iovec half = from[0];
    half.iov_len = (half.iov_len + 1) / 2;
    return call(fd, &half, 1);
  }
  return spoilt != 0 ? refuse<ssize_t>(spoilt) : call(fd, from, count);
}

int fsync(int fd) {
  static const auto call = next<int (*)(int)>("fsync");
  const int spoilt = verdictOf(fd, kSyncCall);
  return spoilt != 0 ? refuse(spoilt) : call(fd);
}
int fdatasync(int fd) {
  static const auto call = next<int (*)(int)>("fdatasync");
  const int spoilt = verdictOf(fd, kSyncCall);
  return spoilt != 0 ? refuse(spoilt) : call(fd);
}

#define FATHOM_FTRUNCATE(name)                                 \
  int name(int fd, off_t size) noexcept {                      \
    static const auto call = next<int (*)(int, off_t)>(#name); \
    const int spoilt = verdictOf(fd, kTruncateCall);           \
    return spoilt != 0 ? refuse(spoilt) : call(fd, size);      \
  }
FATHOM_FTRUNCATE(ftruncate)
FATHOM_FTRUNCATE(ftruncate64)
#define FATHOM_FALLOCATE(name)                                             \
  int name(int fd, int mode, off_t at, off_t size) {                       \
    static const auto call = next<int (*)(int, int, off_t, off_t)>(#name); \
    const int spoilt = verdictOf(fd, kAllocateCall);                       \
    return spoilt != 0 ? refuse(spoilt) : call(fd, mode, at, size);        \
  }
FATHOM_FALLOCATE(fallocate)
FATHOM_FALLOCATE(fallocate64)

int renameat2(int from_folder, const char* from, int to_folder, const char* to, unsigned flags) noexcept {
  int spoilt = verdictAt(from_folder, from, kRenameCall);
  if (spoilt == 0) spoilt = verdictAt(to_folder, to, kRenameCall);
  if (spoilt != 0) return refuse(spoilt);
  return static_cast<int>(::syscall(SYS_renameat2, from_folder, from, to_folder, to, flags));
}
int renameat(int from_folder, const char* from, int to_folder, const char* to) noexcept {
  return renameat2(from_folder, from, to_folder, to, 0);
}
int rename(const char* from, const char* to) noexcept {
  return renameat2(AT_FDCWD, from, AT_FDCWD, to, 0);
}

int unlinkat(int folder, const char* name, int flags) noexcept {
  const int spoilt = verdictAt(folder, name, kUnlinkCall);
  return spoilt != 0 ? refuse(spoilt) : static_cast<int>(::syscall(SYS_unlinkat, folder, name, flags));
}
int unlink(const char* name) noexcept {
  return unlinkat(AT_FDCWD, name, 0);
}
int remove(const char* name) noexcept {
  static const auto call = next<int (*)(const char*)>("remove");
  const int spoilt = verdictAt(AT_FDCWD, name, kUnlinkCall);
  return spoilt != 0 ? refuse(spoilt) : call(name);
}
int mkdirat(int folder, const char* name, mode_t mode) noexcept {
  const int spoilt = verdictAt(folder, name, kMakeFolderCall);
  return spoilt != 0 ? refuse(spoilt) : static_cast<int>(::syscall(SYS_mkdirat, folder, name, mode));
}
int mkdir(const char* name, mode_t mode) noexcept {
  return mkdirat(AT_FDCWD, name, mode);
}

BadPartsControl* fathomBadParts() {
  static BadPartsControl* const of_environment = mappedByEnvironment<BadPartsControl>("FATHOM_BAD_PARTS");
  return of_environment;
}

void fathomFaultPoint(const char* part) {
  BadPartsControl* const all = fathomBadParts();
  if (all == nullptr) return;
  const PartFault fault = all->fault;
  if (fault == PartFault::kNone) return;
  const bool here = ::strcmp(all->part, part) == 0;
  if (fault == PartFault::kSlow) {
    // Of its thread, since the point that it last came by.
    thread_local std::int64_t before_ns = 0;
    const std::int64_t now_ns = nowNs(CLOCK_THREAD_CPUTIME_ID);
    const bool slow = here && before_ns != 0 && nowNs() < all->until_ns;
    if (slow) sleepNs((kSlower - 1) * (now_ns - before_ns));
    before_ns = now_ns;
    if (slow) ++all->hit;
  } else if (here && all->hit++ == 0) {
    fail(fault);
  }
}

}  // extern "C"

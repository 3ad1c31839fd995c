#include "firmware_if/recorder/journal_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>

#include "firmware_if/log/log_events.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kMemory = std::size_t{4} << 20;         // minutes of inputs while the disk refuses
constexpr std::uint64_t kLeastRoom = std::uint64_t{4} << 20;  // less is not worth taking

// Of a log that lost power before its first event was whole: its beginning, or what the disk gives for blocks
// that were never written. errno is set when the disk refuses.
bool beginsAsLog(int fd) {
  std::uint8_t first[4] = {};
  errno = 0;
  if (::pread(fd, first, sizeof first, 0) != sizeof first) return errno == 0;
  constexpr std::uint8_t kSync[4] = {0xED, 0xA1, 0xDA, 0x01}, kNothing[4] = {0, 0, 0, 0};
  return std::equal(first, first + 4, kSync) || std::equal(first, first + 4, kNothing);
}

[[noreturn]] void refuseForeign(const std::filesystem::path& path) {
  throw InputError(path, "", "exists and is no LCM event log; move it away");
}

}  // namespace

JournalFile::JournalFile() {
  // Touched now, so that the first events find their memory there.
  memory_.resize(kMemory);
  memory_.clear();
}

bool JournalFile::open(const std::filesystem::path& path, std::uint64_t room, std::uint64_t leave_free) {
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0 && errno == EISDIR) refuseForeign(path);
  if (fd < 0) return refused("cannot be opened");
  bool good = false;
  try {
    good = goOnBehind(fd, path);
  } catch (...) {
    ::close(fd);
    throw;
  }
  if (!good) {
    ::close(fd);
    return false;
  }
  fd_ = fd;
  takeRoom(room, leave_free);
  return true;
}

// Finds the end of the log, and cuts away what follows it.
bool JournalFile::goOnBehind(int fd, const std::filesystem::path& path) {
  struct stat status = {};
  if (::fstat(fd, &status) != 0) return refused("cannot be looked at");
  if (!S_ISREG(status.st_mode)) refuseForeign(path);
  LogEnd end;
  if (status.st_size > 0) {
    try {
      end = findLogEnd(path);
    } catch (const InputError& e) {
      end.failure = e.what();
    }
    failure_ = end.failure;
    if (!end.failure.empty()) return false;
    if (end.offset == 0 && !beginsAsLog(fd)) {
      if (errno != 0) return refused("cannot be read");
      refuseForeign(path);
    }
  }
  if (::ftruncate(fd, static_cast<off_t>(end.offset)) != 0) return refused("cannot be continued");
  whole_at_start_ = synced_ = cached_from_ = end.offset;
  cut_at_start_ += static_cast<std::uint64_t>(status.st_size) - end.offset;
  next_number_ = end.next_number;
  return ::fsync(fd) == 0 || refused("cannot be made durable");
}

bool JournalFile::refused(const char* what) noexcept {
  failure_ = std::string(what) + " (" + std::strerror(errno) + ")";
  return false;
}

JournalFile::~JournalFile() {
  if (isOpen()) ::close(fd_);
}

void JournalFile::takeRoom(std::uint64_t room, std::uint64_t leave_free) noexcept {
  struct statvfs disk = {};
  if (::fstatvfs(fd_, &disk) != 0) return;
  const std::uint64_t free = std::uint64_t{disk.f_bavail} * disk.f_frsize;
  room = std::min(room, free > leave_free ? free - leave_free : 0);
  for (; room >= kLeastRoom; room /= 2) {
    if (::fallocate(fd_, FALLOC_FL_KEEP_SIZE, static_cast<off_t>(synced_), static_cast<off_t>(room)) == 0 ||
        errno != ENOSPC)  // not every file system can
      return;
  }
}

std::size_t JournalFile::spare() const noexcept {
  return kMemory - memory_.size();
}

void JournalFile::append(std::int64_t timestamp_us, std::string_view channel,
                         std::span<const std::uint8_t> data) {
  assert(logEventBytes(channel, data) <= spare());
  appendLogEvent(memory_, next_number_, timestamp_us, channel, data);
  ++next_number_;
}

bool JournalFile::write() noexcept {
  while (written_ < memory_.size()) {
    const ssize_t n = ::pwrite(fd_, memory_.data() + written_, memory_.size() - written_,
                               static_cast<off_t>(synced_ + written_));
    if (n < 0 && errno == EINTR) continue;
    if (n == 0) errno = ENOSPC;
    if (n <= 0) return refused("cannot be written");
    written_ += static_cast<std::size_t>(n);
  }
  return true;
}

bool JournalFile::sync() noexcept {
  if (written_ == 0) return true;
  const bool good = ::fdatasync(fd_) == 0;
  if (good) {
    synced_ += written_;
    memory_.erase(memory_.begin(), memory_.begin() + static_cast<std::ptrdiff_t>(written_));
    dropFromCache();
  } else {
    (void)refused("cannot be made durable");
  }
  written_ = 0;
  return good;
}

void JournalFile::dropFromCache() noexcept {
  constexpr std::uint64_t kPage = 4096;  // the last one is still written to
  const std::uint64_t whole_pages = synced_ / kPage * kPage;
  if (whole_pages <= cached_from_) return;
  ::posix_fadvise(fd_, static_cast<off_t>(cached_from_), static_cast<off_t>(whole_pages - cached_from_),
                  POSIX_FADV_DONTNEED);
  cached_from_ = whole_pages;
}

// What the file holds stays, durable or not.
void JournalFile::close() noexcept {
  struct stat status = {};
  if (::fstat(fd_, &status) == 0 && ::ftruncate(fd_, status.st_size) == 0) (void)::fsync(fd_);
}

}  // namespace fathom::io

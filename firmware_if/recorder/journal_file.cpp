#include "firmware_if/recorder/journal_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>

#include "firmware_if/mission/log/log_events.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kJournalMemory_bytes = std::size_t{4} << 20;  // minutes of inputs
constexpr std::uint64_t kLeastRoom_bytes = std::uint64_t{4} << 20;  // less is not worth taking

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
  memory_.resize(kJournalMemory_bytes);
  memory_.clear();
}

bool JournalFile::open(const std::filesystem::path& path, std::uint64_t room, std::uint64_t leave_free) {
  Descriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!file.open() && errno == EISDIR) refuseForeign(path);
  if (!file.open()) return refused("cannot be opened");
  if (!continueBehind(file.get(), path)) return false;
  file_ = std::move(file);
  takeRoom(room, leave_free);
  return true;
}

// Finds the end of the log, and cuts away what follows it.
bool JournalFile::continueBehind(int fd, const std::filesystem::path& path) {
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
  return ::fsync(fd) == 0 || refused("cannot be synced to the disk");
}

bool JournalFile::refused(const char* what) noexcept {
  failure_ = std::string(what) + " (" + std::strerror(errno) + ")";
  return false;
}

void JournalFile::takeRoom(std::uint64_t room, std::uint64_t leave_free) noexcept {
  struct statvfs disk = {};
  if (::fstatvfs(file_.get(), &disk) != 0) return;
  const std::uint64_t free = std::uint64_t{disk.f_bavail} * disk.f_frsize;
  room = std::min(room, free > leave_free ? free - leave_free : 0);
  for (; room >= kLeastRoom_bytes; room /= 2) {
    if (::fallocate(file_.get(), FALLOC_FL_KEEP_SIZE, static_cast<off_t>(synced_),
                    static_cast<off_t>(room)) == 0 ||
        errno != ENOSPC)  // not every file system can
      return;
  }
}

std::size_t JournalFile::spare() const noexcept {
  return kJournalMemory_bytes - memory_.size();
}

void JournalFile::append(std::int64_t timestamp_us, std::string_view channel,
                         std::span<const std::uint8_t> data) {
  assert(logEventBytes(channel, data) <= spare());
  appendLogEvent(memory_, next_number_, timestamp_us, channel, data);
  ++next_number_;
}

bool JournalFile::write() noexcept {
  written_ += writeAt(file_.get(), std::span(memory_).subspan(written_), synced_ + written_);
  return written_ == memory_.size() || refused("cannot be written");
}

bool JournalFile::sync() noexcept {
  if (written_ == 0) return true;
  const bool good = ::fdatasync(file_.get()) == 0;
  if (good) {
    synced_ += written_;
    memory_.erase(memory_.begin(), memory_.begin() + static_cast<std::ptrdiff_t>(written_));
    dropFromCache();
  } else {
    (void)refused("cannot be synced to the disk");
  }
  written_ = 0;
  return good;
}

void JournalFile::dropFromCache() noexcept {
  constexpr std::uint64_t kPage = 4096;  // the last one is still written to
  const std::uint64_t whole_pages = synced_ / kPage * kPage;
  if (whole_pages <= cached_from_) return;
  ::posix_fadvise(file_.get(), static_cast<off_t>(cached_from_),
                  static_cast<off_t>(whole_pages - cached_from_), POSIX_FADV_DONTNEED);
  cached_from_ = whole_pages;
}

void JournalFile::close() noexcept {
  struct stat status = {};
  if (::fstat(file_.get(), &status) == 0 && ::ftruncate(file_.get(), status.st_size) == 0)
    (void)::fsync(file_.get());
}

}  // namespace fathom::io

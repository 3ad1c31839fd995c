#include "tests/support/disk_log.hpp"

#include <fcntl.h>
#include <stdio.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace fathom::test {
namespace {

DiskLog* listening = nullptr;

void noteSync(int file) {
  if (listening == nullptr) return;
  std::error_code ignored;
  listening->note("sync " +
                  std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(file), ignored).string());
}

int noteRename(const char* from, const char* to, unsigned flags) {
  const auto failed = static_cast<int>(::syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, flags));
  if (failed == 0 && listening != nullptr) listening->note(std::string("rename ") + from + " " + to);
  return failed;
}

}  // namespace

DiskLog::DiskLog() {
  listening = this;
}

DiskLog::~DiskLog() {
  listening = nullptr;
}

std::ptrdiff_t DiskLog::last(const std::string& event) const {
  for (std::size_t i = events_.size(); i-- > 0;)
    if (events_[i] == event) return static_cast<std::ptrdiff_t>(i);
  return -1;
}

std::ptrdiff_t DiskLog::synced(const std::filesystem::path& path) const {
  return last("sync " + path.string());
}

std::ptrdiff_t DiskLog::renamed(const std::filesystem::path& from, const std::filesystem::path& to) const {
  return last("rename " + from.string() + " " + to.string());
}

}  // namespace fathom::test

extern "C" {

int fsync(int file) {
  fathom::test::noteSync(file);
  return static_cast<int>(::syscall(SYS_fsync, file));
}

int fdatasync(int file) {
  fathom::test::noteSync(file);
  return static_cast<int>(::syscall(SYS_fdatasync, file));
}

int rename(const char* from, const char* to) noexcept {
  return fathom::test::noteRename(from, to, 0);
}

int renameat2(int, const char* from, int, const char* to, unsigned flags) noexcept {
  return fathom::test::noteRename(from, to, flags);
}

}  // extern "C"

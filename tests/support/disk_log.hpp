#pragma once

#include <fcntl.h>
#include <stdio.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <vector>

namespace fathom::test {

// Notes, while it lives, in which order this program brings files to the disk and renames them. To be
// included once in a program: it stands in for fsync, fdatasync, rename and renameat2. One at a time.
class DiskLog {
 public:
  DiskLog() { listening = this; }
  ~DiskLog() { listening = nullptr; }
  DiskLog(const DiskLog&) = delete;
  DiskLog& operator=(const DiskLog&) = delete;

  // When it was, last; -1: never.
  [[nodiscard]] std::ptrdiff_t synced(const std::filesystem::path& path) const {
    return last("sync " + path.string());
  }
  [[nodiscard]] std::ptrdiff_t renamed(const std::filesystem::path& from,
                                       const std::filesystem::path& to) const {
    return last("rename " + from.string() + " " + to.string());
  }

  static void noteSync(int file) {
    if (listening == nullptr) return;
    std::error_code ignored;
    const std::string name = "/proc/self/fd/" + std::to_string(file);
    listening->events_.push_back("sync " + std::filesystem::read_symlink(name, ignored).string());
  }
  static int rename(const char* from, const char* to, unsigned flags) {
    const auto failed = static_cast<int>(::syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, flags));
    if (failed == 0 && listening != nullptr)
      listening->events_.push_back(std::string("rename ") + from + " " + to);
    return failed;
  }

 private:
  [[nodiscard]] std::ptrdiff_t last(const std::string& event) const {
    for (std::size_t i = events_.size(); i-- > 0;)
      if (events_[i] == event) return static_cast<std::ptrdiff_t>(i);
    return -1;
  }

  static inline DiskLog* listening = nullptr;
  std::vector<std::string> events_;
};

}  // namespace fathom::test

extern "C" {

int fsync(int file) {
  fathom::test::DiskLog::noteSync(file);
  return static_cast<int>(::syscall(SYS_fsync, file));
}
int fdatasync(int file) {
  fathom::test::DiskLog::noteSync(file);
  return static_cast<int>(::syscall(SYS_fdatasync, file));
}
int rename(const char* from, const char* to) noexcept {
  return fathom::test::DiskLog::rename(from, to, 0);
}
int renameat2(int, const char* from, int, const char* to, unsigned flags) noexcept {
  return fathom::test::DiskLog::rename(from, to, flags);
}

}  // extern "C"

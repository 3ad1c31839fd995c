#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace fathom::test {

// Notes, while it lives, in which order this program brings files to the disk and renames them. Link
// disk_log.cpp into the test: it stands in for fsync, fdatasync, rename and renameat2. One at a time.
class DiskLog {
 public:
  DiskLog();
  ~DiskLog();
  DiskLog(const DiskLog&) = delete;
  DiskLog& operator=(const DiskLog&) = delete;

  // When it was, last; -1: never.
  [[nodiscard]] std::ptrdiff_t synced(const std::filesystem::path& path) const;
  [[nodiscard]] std::ptrdiff_t renamed(const std::filesystem::path& from,
                                       const std::filesystem::path& to) const;

  void note(std::string event) { events_.push_back(std::move(event)); }

 private:
  [[nodiscard]] std::ptrdiff_t last(const std::string& event) const;

  std::vector<std::string> events_;
};

}  // namespace fathom::test

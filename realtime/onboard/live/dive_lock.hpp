#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>

namespace fathom::onboard {

// Lock of a mission folder, so that one program dives in it (flock on state/lock, which holds its process
// number). Where the disk takes no file, the lock is on the folder itself, without the number.
class DiveLock {
 public:
  // Throws InputError, with the other's number, when another program dives in this folder.
  explicit DiveLock(const std::filesystem::path& mission);
  ~DiveLock();
  DiveLock(const DiveLock&) = delete;
  DiveLock& operator=(const DiveLock&) = delete;

  // The program that dives there, if one does.
  [[nodiscard]] static std::optional<pid_t> holder(const std::filesystem::path& mission);

 private:
  int file_ = -1;
};

}  // namespace fathom::onboard

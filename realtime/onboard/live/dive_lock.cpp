#include "realtime/onboard/live/dive_lock.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <string>
#include <system_error>

#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/onboard/checkpoint/checkpoint_names.hpp"

namespace fathom::onboard {
namespace {

std::filesystem::path lockOf(const std::filesystem::path& mission) {
  return stateFolder(mission) / "lock";
}

pid_t numberIn(int file) {
  std::array<char, 32> text{};
  return ::pread(file, text.data(), text.size() - 1, 0) > 0 ? static_cast<pid_t>(std::atol(text.data())) : 0;
}

}  // namespace

DiveLock::DiveLock(const std::filesystem::path& mission) {
  std::error_code ignored;
  std::filesystem::create_directories(stateFolder(mission), ignored);
  file_ = ::open(lockOf(mission).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  const bool numbered = file_ >= 0;
  if (!numbered) file_ = ::open(mission.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file_ < 0) return;  // the reader of mission.toml reports the error
  if (lockedElsewhere(file_)) {
    const pid_t other = numbered ? numberIn(file_) : 0;
    ::close(file_);
    throw InputError(mission, "",
                     "another program dives in this folder" +
                         (other > 0 ? " (process " + std::to_string(other) + ")" : std::string()) +
                         "; end that, or give each dive a folder of its own");
  }
  if (!numbered) return;
  const std::string number = std::to_string(::getpid()) + "\n";
  if (::ftruncate(file_, 0) == 0) (void)!::pwrite(file_, number.data(), number.size(), 0);
}

DiveLock::~DiveLock() {
  if (file_ >= 0) ::close(file_);
}

std::optional<pid_t> DiveLock::holder(const std::filesystem::path& mission) {
  const int file = ::open(lockOf(mission).c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return std::nullopt;
  const bool held = lockedElsewhere(file, LOCK_SH);
  const pid_t number = held ? numberIn(file) : 0;
  ::close(file);
  return number > 0 ? std::optional(number) : std::nullopt;
}

}  // namespace fathom::onboard

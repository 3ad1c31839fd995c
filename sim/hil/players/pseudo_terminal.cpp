#include "sim/hil/players/pseudo_terminal.hpp"

#include <fcntl.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <system_error>

#include "realtime/base/input_error.hpp"

namespace fathom::sim {

PseudoTerminal::PseudoTerminal(std::filesystem::path link) : link_(std::move(link)) {
  const auto fail = [this](const char* what) {
    const int error = errno;
    if (slave_ >= 0) ::close(slave_);
    if (master_ >= 0) ::close(master_);
    throw std::system_error(error, std::generic_category(), what);
  };
  master_ = ::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (master_ < 0 || ::grantpt(master_) != 0 || ::unlockpt(master_) != 0) fail("a pseudo-terminal");
  std::array<char, 128> name{};
  if (::ptsname_r(master_, name.data(), name.size()) != 0) fail("a pseudo-terminal's name");
  slave_ = ::open(name.data(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  termios raw{};
  if (slave_ < 0 || ::tcgetattr(slave_, &raw) != 0) fail("a pseudo-terminal's other end");
  ::cfmakeraw(&raw);
  ::tcsetattr(slave_, TCSANOW, &raw);
  std::error_code error;
  if (std::filesystem::is_symlink(link_)) std::filesystem::remove(link_, error);
  std::filesystem::create_symlink(name.data(), link_, error);
  if (error) {
    ::close(slave_);
    ::close(master_);
    throw InputError(link_.string(), "",
                     "cannot become a link to a pseudo-terminal (" + error.message() + ")");
  }
}

PseudoTerminal::~PseudoTerminal() {
  std::error_code ignored;
  std::filesystem::remove(link_, ignored);
  ::close(slave_);
  ::close(master_);
}

bool PseudoTerminal::write(std::span<const std::uint8_t> bytes) noexcept {
  int waiting = 0;
  if (::ioctl(slave_, FIONREAD, &waiting) == 0 && waiting > static_cast<int>(kUnreadBytes)) {
    ::tcflush(slave_, TCIFLUSH);
    unread_ += static_cast<std::uint64_t>(waiting);
  }
  while (!bytes.empty()) {
    const ssize_t n = ::write(master_, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      unread_ += bytes.size();
      return false;
    }
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

std::size_t PseudoTerminal::read(std::span<std::uint8_t> buffer) noexcept {
  const ssize_t n = ::read(master_, buffer.data(), buffer.size());
  return n > 0 ? static_cast<std::size_t>(n) : 0;
}

}  // namespace fathom::sim

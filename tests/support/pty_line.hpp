#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <pty.h>
#include <termios.h>
#include <unistd.h>

#include <cstdint>
#include <span>
#include <string>

namespace fathom::test {

// A pseudo-terminal under a name that stays: the program opens `name`, the test holds the other end, as the
// instrument would. unplug() and plug() are a cable pulled and put back.
class PtyLine {
 public:
  PtyLine()
      : name_(::testing::TempDir() + "fathom_line_" + std::to_string(::getpid()) + "_" +
              std::to_string(counter()++)) {
    plug();
  }
  ~PtyLine() { unplug(); }
  PtyLine(const PtyLine&) = delete;
  PtyLine& operator=(const PtyLine&) = delete;

  void plug() {
    char device[256];
    int line = -1;
    ASSERT_EQ(::openpty(&instrument_, &line, device, nullptr, nullptr), 0);
    termios raw = {};
    ::tcgetattr(line, &raw);
    ::cfmakeraw(&raw);
    ::tcsetattr(line, TCSANOW, &raw);
    // Held open, so that bytes sent before the program opens it are kept.
    line_ = line;
    ::unlink(name_.c_str());
    ASSERT_EQ(::symlink(device, name_.c_str()), 0);
  }
  void unplug() {
    if (instrument_ < 0) return;
    ::close(line_);
    ::close(instrument_);
    instrument_ = line_ = -1;
    ::unlink(name_.c_str());
  }
  void send(std::span<const std::uint8_t> bytes) const {
    ASSERT_EQ(::write(instrument_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  // The same where nobody may be reading: what there is no room for is lost, as on a wire.
  void offer(std::span<const std::uint8_t> bytes) const {
    if (!pollFor(POLLOUT, 0)) return;
    [[maybe_unused]] const ssize_t written = ::write(instrument_, bytes.data(), bytes.size());
  }
  // What the program has sent.
  [[nodiscard]] ssize_t read(std::span<std::uint8_t> buffer, int timeout_ms = 0) const {
    return pollFor(POLLIN, timeout_ms) ? ::read(instrument_, buffer.data(), buffer.size()) : 0;
  }
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] int line() const { return line_; }

 private:
  [[nodiscard]] bool pollFor(short events, int timeout_ms) const {
    pollfd line = {instrument_, events, 0};
    return ::poll(&line, 1, timeout_ms) == 1 && (line.revents & events) != 0;
  }
  static int& counter() {
    static int n = 0;
    return n;
  }
  std::string name_;
  int instrument_ = -1, line_ = -1;
};

}  // namespace fathom::test

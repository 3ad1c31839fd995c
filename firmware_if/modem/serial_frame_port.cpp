#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

#include "firmware_if/modem_ports.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

struct Rate {
  int baud;
  speed_t code;
};
constexpr std::array<Rate, 13> kRates = {{{300, B300},
                                          {600, B600},
                                          {1200, B1200},
                                          {2400, B2400},
                                          {4800, B4800},
                                          {9600, B9600},
                                          {19200, B19200},
                                          {38400, B38400},
                                          {57600, B57600},
                                          {115200, B115200},
                                          {230400, B230400},
                                          {460800, B460800},
                                          {921600, B921600}}};

speed_t rateCode(const std::string& device, int baud) {
  std::string known;
  for (const Rate& rate : kRates) {
    if (rate.baud == baud) return rate.code;
    known += (known.empty() ? "" : ", ") + std::to_string(rate.baud);
  }
  throw InputError(device, "rate", std::to_string(baud) + " baud is not one of " + known);
}

}  // namespace

SerialFramePort::SerialFramePort(const std::string& device, int baud) {
  const speed_t code = rateCode(device, baud);
  fd_ = ::open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) throw InputError(device, "", std::string("cannot be opened (") + std::strerror(errno) + ")");
  termios line = {};
  if (::tcgetattr(fd_, &line) != 0) {
    ::close(fd_);
    throw InputError(device, "", "is no serial device");
  }
  ::cfmakeraw(&line);
  line.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS);
  line.c_cflag |= CLOCAL | CREAD;
  line.c_cc[VMIN] = 0;
  line.c_cc[VTIME] = 0;
  ::cfsetispeed(&line, code);
  ::cfsetospeed(&line, code);
  // tcsetattr succeeds when any setting took: read back whether the rate did.
  termios found = {};
  if (::tcsetattr(fd_, TCSANOW, &line) != 0 || ::tcgetattr(fd_, &found) != 0 ||
      ::cfgetospeed(&found) != code) {
    ::close(fd_);
    throw InputError(device, "rate", std::to_string(baud) + " baud is refused by the device");
  }
}

SerialFramePort::~SerialFramePort() {
  ::close(fd_);
}

// Writes what the device takes of the frame under way; true when nothing is left.
bool SerialFramePort::drain() noexcept {
  while (line_sent_ < line_size_) {
    const ssize_t n = ::write(fd_, line_.data() + line_sent_, line_size_ - line_sent_);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    line_sent_ += static_cast<std::size_t>(n);
  }
  return true;
}

bool SerialFramePort::send(std::span<const std::uint8_t> frame) noexcept {
  // The rest of the frame before goes first: a frame is never cut by the next.
  if (!drain()) return false;
  line_size_ = slipEncode(frame, line_);
  line_sent_ = 0;
  if (line_size_ == 0) return false;
  static_cast<void>(drain());
  return true;
}

std::size_t SerialFramePort::receive(std::span<std::uint8_t> buffer) noexcept {
  static_cast<void>(drain());
  // Noise without a frame must not hold the caller: the rest waits for the next call.
  constexpr int kMaxReads = 16;
  for (int i = 0; i < kMaxReads; ++i) {
    while (input_at_ < input_size_) {
      if (!decoder_.push(input_[input_at_++])) continue;
      const auto frame = decoder_.frame();
      if (frame.size() > buffer.size()) {
        ++dropped_;
        continue;
      }
      std::memcpy(buffer.data(), frame.data(), frame.size());
      return frame.size();
    }
    const ssize_t n = ::read(fd_, input_.data(), input_.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return 0;
    input_at_ = 0;
    input_size_ = static_cast<std::size_t>(n);
  }
  return 0;
}

}  // namespace fathom::io

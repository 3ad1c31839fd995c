#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
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

enum class Failure { kNone, kOpen, kNoTerminal, kRate };
struct Opened {
  int fd = -1;
  Failure failure = Failure::kNone;
  int error = 0;  // errno
};

// Opens a serial line raw, 8N1, without waiting.
Opened openLine(const std::string& device, speed_t code) noexcept {
  const int fd = ::open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return {-1, Failure::kOpen, errno};
  termios line = {};
  if (::tcgetattr(fd, &line) != 0) {
    ::close(fd);
    return {-1, Failure::kNoTerminal, 0};
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
  if (::tcsetattr(fd, TCSANOW, &line) != 0 || ::tcgetattr(fd, &found) != 0 || ::cfgetospeed(&found) != code) {
    ::close(fd);
    return {-1, Failure::kRate, 0};
  }
  return {fd, Failure::kNone, 0};
}

std::int64_t monotonicNs() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace

SerialFramePort::SerialFramePort(const std::string& device, int baud, double reopen_interval_s)
    : device_(device),
      rate_code_(rateCode(device, baud)),
      reopen_interval_ns_(static_cast<std::int64_t>(reopen_interval_s * 1e9)) {
  Opened opened = openLine(device, rate_code_);
  switch (opened.failure) {
    case Failure::kNone:
      break;
    case Failure::kOpen:
      throw InputError(device, "", std::string("cannot be opened (") + std::strerror(opened.error) + ")");
    case Failure::kNoTerminal:
      throw InputError(device, "", "is no serial device");
    case Failure::kRate:
      throw InputError(device, "rate", std::to_string(baud) + " baud is refused by the device");
  }
  fd_ = opened.fd;
}

SerialFramePort::~SerialFramePort() {
  if (fd_ >= 0) ::close(fd_);
}

void SerialFramePort::close() noexcept {
  ::close(fd_);
  fd_ = -1;
  ++disconnects_;
  next_open_ns_ = monotonicNs() + reopen_interval_ns_;
  // What was half sent will not be completed.
  line_size_ = line_sent_ = 0;
}

bool SerialFramePort::ready() noexcept {
  if (fd_ >= 0 && input_at_ == input_size_) {
    pollfd line = {fd_, POLLIN, 0};
    // A line that hung up may hold bytes yet: they are read first.
    if (::poll(&line, 1, 0) == 1 && (line.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0 &&
        (line.revents & POLLIN) == 0)
      close();
  }
  if (fd_ >= 0) return true;
  const std::int64_t now_ns = monotonicNs();
  if (now_ns < next_open_ns_) return false;
  next_open_ns_ = now_ns + reopen_interval_ns_;
  fd_ = openLine(device_, rate_code_).fd;
  if (fd_ < 0) return false;
  // Nor will what was half received.
  input_size_ = input_at_ = 0;
  decoder_.restart();
  return true;
}

// Writes what the device takes of the frame under way; true when nothing is left.
bool SerialFramePort::drain() noexcept {
  while (line_sent_ < line_size_) {
    const ssize_t n = ::write(fd_, line_.data() + line_sent_, line_size_ - line_sent_);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK) close();
    if (n <= 0) return false;
    line_sent_ += static_cast<std::size_t>(n);
  }
  return true;
}

bool SerialFramePort::send(std::span<const std::uint8_t> frame) noexcept {
  // The rest of the frame before goes first: a frame is never cut by the next.
  if (!ready() || !drain()) return false;
  line_size_ = slipEncode(frame, line_);
  line_sent_ = 0;
  if (line_size_ == 0) return false;
  static_cast<void>(drain());
  return fd_ >= 0;
}

std::size_t SerialFramePort::receive(std::span<std::uint8_t> buffer) noexcept {
  if (!ready() && input_at_ == input_size_) return 0;
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
    if (fd_ < 0) return 0;
    const ssize_t n = ::read(fd_, input_.data(), input_.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK) close();
    if (n <= 0) return 0;
    input_at_ = 0;
    input_size_ = static_cast<std::size_t>(n);
  }
  return 0;
}

}  // namespace fathom::io

#include "firmware_if/devices/serial/serial_line.hpp"

#include <fcntl.h>
#include <linux/serial.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

struct BaudRate {
  int baud;
  speed_t code;
};
constexpr BaudRate kRates[] = {
    {300, B300},         {600, B600},         {1200, B1200},      {2400, B2400},     {4800, B4800},
    {9600, B9600},       {19200, B19200},     {38400, B38400},    {57600, B57600},   {115200, B115200},
    {230400, B230400},   {460800, B460800},   {500000, B500000},  {921600, B921600}, {1000000, B1000000},
    {1500000, B1500000}, {2000000, B2000000}, {3000000, B3000000}};

speed_t rateCode(const std::string& device, int baud) {
  for (const BaudRate& rate : kRates)
    if (rate.baud == baud) return rate.code;
  throw InputError(device, "rate", std::to_string(baud) + " baud is not one of " + SerialLine::rates());
}

constexpr short kHungUp = POLLHUP | POLLERR | POLLNVAL;

// Drivers without the setting (pseudo-terminals, CDC-ACM) hand bytes over at once anyway.
void askLowLatency(int fd) noexcept {
  serial_struct settings = {};
  if (::ioctl(fd, TIOCGSERIAL, &settings) != 0) return;
  settings.flags |= ASYNC_LOW_LATENCY;
  static_cast<void>(::ioctl(fd, TIOCSSERIAL, &settings));
}

}  // namespace

bool SerialLine::knownRate(int baud) noexcept {
  return std::ranges::any_of(kRates, [&](const BaudRate& rate) { return rate.baud == baud; });
}

std::string SerialLine::rates() {
  std::string known;
  for (const BaudRate& rate : kRates) known += (known.empty() ? "" : ", ") + std::to_string(rate.baud);
  return known;
}

SerialLine::SerialLine(const std::string& device, int baud, IfAbsent if_absent, double reopen_interval_s)
    : device_(device),
      rate_code_(rateCode(device, baud)),
      reopen_interval_ns_(static_cast<std::int64_t>(reopen_interval_s * 1e9)) {
  const Failure failure = open();
  if (if_absent == IfAbsent::kWait) return;
  switch (failure) {
    case Failure::kNone:
      break;
    case Failure::kOpen:
      throw InputError(device, "", std::string("cannot be opened (") + std::strerror(error_) + ")");
    case Failure::kNoTerminal:
      throw InputError(device, "", "is no serial device");
    case Failure::kTaken:
      throw InputError(device, "", "is in use by another program; end that first");
    case Failure::kRate:
      throw InputError(device, "rate", std::to_string(baud) + " baud is refused by the device");
  }
}

SerialLine::~SerialLine() {
  if (fd_ < 0) return;
  static_cast<void>(::ioctl(fd_, TIOCNXCL));
  ::close(fd_);
}

std::string_view SerialLine::reason() const noexcept {
  if (fd_ >= 0) return {};
  switch (failure_) {
    case Failure::kNone:
      return "has gone away";
    case Failure::kOpen: {
      const char* text = ::strerrordesc_np(error_);
      return text == nullptr ? "cannot be opened" : text;
    }
    case Failure::kNoTerminal:
      return "is no serial device";
    case Failure::kTaken:
      return "is in use by another program";
    case Failure::kRate:
      return "refuses its baud rate";
  }
  return {};
}

SerialLine::Failure SerialLine::open() noexcept {
  return failure_ = tryToOpen();
}

SerialLine::Failure SerialLine::tryToOpen() noexcept {
  next_open_ns_ = rt::RealClock().monotonicNs() + reopen_interval_ns_;
  const int fd = ::open(device_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  error_ = errno;
  if (fd < 0) return error_ == EBUSY ? Failure::kTaken : Failure::kOpen;
  const auto refuse = [&](Failure why) {
    ::close(fd);
    return why;
  };
  termios line = {};
  if (::tcgetattr(fd, &line) != 0) return refuse(Failure::kNoTerminal);
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) return refuse(Failure::kTaken);
  ::cfmakeraw(&line);
  line.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS);
  line.c_cflag |= CLOCAL | CREAD;
  line.c_cc[VMIN] = 0;
  line.c_cc[VTIME] = 0;
  ::cfsetispeed(&line, rate_code_);
  ::cfsetospeed(&line, rate_code_);
  // tcsetattr succeeds when any setting took: read back whether the rate did.
  termios found = {};
  if (::tcsetattr(fd, TCSANOW, &line) != 0 || ::tcgetattr(fd, &found) != 0 ||
      ::cfgetospeed(&found) != rate_code_)
    return refuse(Failure::kRate);
  static_cast<void>(::ioctl(fd, TIOCEXCL));
  askLowLatency(fd);
  fd_ = fd;
  ++connections_;
  return Failure::kNone;
}

void SerialLine::lose() noexcept {
  // Exclusive use outlives the descriptor while another holds the terminal open.
  static_cast<void>(::ioctl(fd_, TIOCNXCL));
  ::close(fd_);
  fd_ = -1;
  ++disconnects_;
  next_open_ns_ = rt::RealClock().monotonicNs() + reopen_interval_ns_;
}

bool SerialLine::ready() noexcept {
  if (fd_ >= 0) {
    pollfd line = {fd_, POLLIN, 0};
    // A line that hung up may hold bytes yet: they are read first.
    if (::poll(&line, 1, 0) == 1 && (line.revents & kHungUp) != 0 && (line.revents & POLLIN) == 0) lose();
  }
  if (fd_ >= 0) return true;
  return rt::RealClock().monotonicNs() >= next_open_ns_ && open() == Failure::kNone;
}

std::size_t SerialLine::read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept {
  if (!ready()) {
    if (timeout_ms > 0) ::poll(nullptr, 0, timeout_ms);
    return 0;
  }
  pollfd line = {fd_, POLLIN, 0};
  if (::poll(&line, 1, timeout_ms) != 1) return 0;
  ssize_t n = 0;
  do {
    n = ::read(fd_, buffer.data(), buffer.size());
  } while (n < 0 && errno == EINTR);
  if (n > 0) return static_cast<std::size_t>(n);
  // A terminal reads as empty for ever after its other end has gone.
  if (n == 0 ? (line.revents & kHungUp) != 0 : errno != EAGAIN && errno != EWOULDBLOCK) lose();
  return 0;
}

std::size_t SerialLine::write(std::span<const std::uint8_t> bytes) noexcept {
  while (fd_ >= 0 && !bytes.empty()) {
    const ssize_t n = ::write(fd_, bytes.data(), bytes.size());
    if (n >= 0) return static_cast<std::size_t>(n);
    if (errno == EINTR) continue;
    if (errno != EAGAIN && errno != EWOULDBLOCK) lose();
    break;
  }
  return 0;
}

}  // namespace fathom::io

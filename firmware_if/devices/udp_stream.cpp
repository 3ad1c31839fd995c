#include "firmware_if/devices/udp_stream.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "realtime/kernel/clock.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kLongestWaitNs = 16'000'000'000;

}  // namespace

UdpStream::UdpStream(const std::string& address, std::uint16_t port, std::int64_t first_wait_ns)
    : port_(port), wait_(first_wait_ns, kLongestWaitNs) {
  in_addr own = {};
  if (::inet_pton(AF_INET, address.c_str(), &own) != 1)
    throw InputError(address, "", "is no IPv4 address; give one as 127.0.0.1, or 0.0.0.0 for all");
  ipv4_ = own.s_addr;
  static_cast<void>(ready());
}

UdpStream::~UdpStream() {
  if (socket_ >= 0) ::close(socket_);
}

bool UdpStream::ready() noexcept {
  if (socket_ >= 0) return true;
  const std::int64_t now_ns = rt::RealClock().monotonicNs();
  if (!wait_.due(now_ns)) return false;
  sockaddr_in local = {};
  local.sin_family = AF_INET;
  local.sin_port = htons(port_);
  local.sin_addr.s_addr = ipv4_;
  socklen_t size = sizeof local;
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0 || ::bind(fd, reinterpret_cast<const sockaddr*>(&local), sizeof local) != 0 ||
      ::getsockname(fd, reinterpret_cast<sockaddr*>(&local), &size) != 0) {
    error_ = errno;
    if (fd >= 0) ::close(fd);
    wait_.failed(now_ns);
    return false;
  }
  socket_ = fd;
  port_ = ntohs(local.sin_port);
  return true;
}

std::string_view UdpStream::reason() const noexcept {
  if (socket_ >= 0) return {};
  const char* text = ::strerrordesc_np(error_);
  return text == nullptr ? "cannot be bound" : text;
}

std::size_t UdpStream::read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept {
  if (!ready()) {
    ::poll(nullptr, 0, timeout_ms);
    return 0;
  }
  if (at_ == size_) {
    pollfd socket = {socket_, POLLIN, 0};
    if (::poll(&socket, 1, timeout_ms) != 1) return 0;
    const ssize_t n = ::recv(socket_, datagram_.data(), datagram_.size(), 0);
    if (n <= 0) return 0;
    at_ = 0;
    size_ = static_cast<std::size_t>(n);
  }
  const std::size_t count = std::min(buffer.size(), size_ - at_);
  std::memcpy(buffer.data(), datagram_.data() + at_, count);
  at_ += count;
  return count;
}

}  // namespace fathom::io

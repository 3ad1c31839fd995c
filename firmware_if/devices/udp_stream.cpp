#include "firmware_if/devices/udp_stream.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "realtime/kernel/input_error.hpp"

namespace fathom::io {

UdpStream::UdpStream(const std::string& address, std::uint16_t port) {
  sockaddr_in local = {};
  local.sin_family = AF_INET;
  local.sin_port = htons(port);
  if (::inet_pton(AF_INET, address.c_str(), &local.sin_addr) != 1)
    throw InputError(address, "", "is no IPv4 address; give one as 127.0.0.1, or 0.0.0.0 for all");
  socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  socklen_t size = sizeof local;
  if (socket_ < 0 || ::bind(socket_, reinterpret_cast<const sockaddr*>(&local), sizeof local) != 0 ||
      ::getsockname(socket_, reinterpret_cast<sockaddr*>(&local), &size) != 0) {
    const std::string reason = std::strerror(errno);
    if (socket_ >= 0) ::close(socket_);
    throw InputError(address + ":" + std::to_string(port), "",
                     "cannot be bound (" + reason + "); give a free port of this machine");
  }
  port_ = ntohs(local.sin_port);
}

UdpStream::~UdpStream() {
  ::close(socket_);
}

std::size_t UdpStream::read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept {
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

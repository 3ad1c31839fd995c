#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "firmware_if/modem/modem_ports.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

sockaddr_in parseAddress(const std::string& address, std::uint16_t port) {
  sockaddr_in result = {};
  result.sin_family = AF_INET;
  result.sin_port = htons(port);
  if (::inet_pton(AF_INET, address.c_str(), &result.sin_addr) != 1)
    throw InputError(address, "", "is no IPv4 address; give one as 127.0.0.1");
  return result;
}

}  // namespace

UdpFramePort::UdpFramePort(const std::string& bind_address, std::uint16_t bind_port,
                           const std::string& peer_address, std::uint16_t peer_port)
    : peer_given_(peer_port != 0) {
  sockaddr_in local = parseAddress(bind_address, bind_port);
  if (peer_given_) {
    const sockaddr_in peer = parseAddress(peer_address, peer_port);
    peer_ = {peer.sin_addr.s_addr, peer_port};
  }
  socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  socklen_t size = sizeof local;
  if (socket_ < 0 || ::bind(socket_, reinterpret_cast<const sockaddr*>(&local), sizeof local) != 0 ||
      ::getsockname(socket_, reinterpret_cast<sockaddr*>(&local), &size) != 0) {
    const std::string reason = std::strerror(errno);
    if (socket_ >= 0) ::close(socket_);
    throw InputError(bind_address + ":" + std::to_string(bind_port), "",
                     "cannot be bound (" + reason + "); give a free port of this machine");
  }
  bound_port_ = ntohs(local.sin_port);
}

UdpFramePort::~UdpFramePort() {
  ::close(socket_);
}

bool UdpFramePort::send(std::span<const std::uint8_t> frame) noexcept {
  if (peer_.port == 0 || frame.empty() || frame.size() > kMaxFrameBytes) return false;
  sockaddr_in peer = {};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(peer_.port);
  peer.sin_addr.s_addr = peer_.ipv4;
  const ssize_t sent =
      ::sendto(socket_, frame.data(), frame.size(), 0, reinterpret_cast<const sockaddr*>(&peer), sizeof peer);
  return sent == static_cast<ssize_t>(frame.size());
}

void UdpFramePort::answerHeard() noexcept {
  if (!peer_given_) peer_ = heard_;
}

std::size_t UdpFramePort::receive(std::span<std::uint8_t> buffer) noexcept {
  // One byte more than a frame: a datagram that fills it is too long.
  std::array<std::uint8_t, kMaxFrameBytes + 1> datagram;
  // A flood of unusable datagrams must not hold the caller: some are dropped, the rest wait for the next
  // call.
  constexpr int kMaxDrops = 64;
  for (int i = 0; i < kMaxDrops; ++i) {
    sockaddr_in from = {};
    socklen_t from_size = sizeof from;
    const ssize_t n = ::recvfrom(socket_, datagram.data(), datagram.size(), 0,
                                 reinterpret_cast<sockaddr*>(&from), &from_size);
    // Refused: an earlier datagram of ours found nobody. That is silence, and must not hide what waits.
    if (n < 0 && (errno == ECONNREFUSED || errno == EINTR)) continue;
    if (n < 0) return 0;
    const auto size = static_cast<std::size_t>(n);
    const Address sender = {from.sin_addr.s_addr, ntohs(from.sin_port)};
    if (size > 0 && size <= kMaxFrameBytes && size <= buffer.size() && (sender == peer_ || !peer_given_)) {
      heard_ = sender;
      std::memcpy(buffer.data(), datagram.data(), size);
      return size;
    }
    ++dropped_;
  }
  return 0;
}

}  // namespace fathom::io

#include "firmware_if/devices/udp_socket.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kLongestUdpWait_ns = 16 * kSecond_ns;

sockaddr_in socketAddress(const UdpAddress& address) noexcept {
  sockaddr_in out = {};
  out.sin_family = AF_INET;
  out.sin_port = htons(address.port);
  out.sin_addr.s_addr = address.ipv4;
  return out;
}

}  // namespace

UdpAddress parseUdpAddress(const std::string& ipv4, std::uint16_t port, const std::string& where) {
  in_addr address = {};
  if (::inet_pton(AF_INET, ipv4.c_str(), &address) != 1)
    throw InputError(where, "",
                     ipv4 + " is no IPv4 address; give one as 127.0.0.1 (to listen: 0.0.0.0 for all)");
  return {address.s_addr, port};
}

int UdpSocket::bind(const UdpAddress& local) noexcept {
  sockaddr_in address = socketAddress(local);
  socklen_t size = sizeof address;
  Descriptor opened(::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!opened.open() || ::bind(opened.get(), reinterpret_cast<const sockaddr*>(&address), size) != 0 ||
      ::getsockname(opened.get(), reinterpret_cast<sockaddr*>(&address), &size) != 0)
    return errno;
  socket_ = std::move(opened);
  port_ = ntohs(address.sin_port);
  return 0;
}

std::optional<std::size_t> UdpSocket::receive(std::span<std::uint8_t> buffer, UdpAddress& sender) noexcept {
  sockaddr_in from = {};
  socklen_t from_size = sizeof from;
  ssize_t n = 0;
  do {
    n = ::recvfrom(socket_.get(), buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from),
                   &from_size);
    // ECONNREFUSED reports that an earlier datagram of ours found no receiver; received ones are still
    // queued.
  } while (n < 0 && (errno == ECONNREFUSED || errno == EINTR));
  if (n < 0) return std::nullopt;
  sender = {from.sin_addr.s_addr, ntohs(from.sin_port)};
  return static_cast<std::size_t>(n);
}

bool UdpSocket::send(std::span<const std::uint8_t> datagram, const UdpAddress& to) noexcept {
  const sockaddr_in address = socketAddress(to);
  return ::sendto(socket_.get(), datagram.data(), datagram.size(), 0,
                  reinterpret_cast<const sockaddr*>(&address),
                  sizeof address) == static_cast<ssize_t>(datagram.size());
}

UdpStream::UdpStream(const std::string& address, std::uint16_t port, std::int64_t first_wait_ns)
    : local_(parseUdpAddress(address, port)), wait_(first_wait_ns, kLongestUdpWait_ns) {
  static_cast<void>(ready());
}

bool UdpStream::ready() noexcept {
  if (socket_.isOpen()) return true;
  const std::int64_t now_ns = rt::RealClock().monotonicNs();
  if (!wait_.due(now_ns)) return false;
  error_ = socket_.bind(local_);
  if (error_ != 0) wait_.failed(now_ns);
  return error_ == 0;
}

std::string_view UdpStream::reason() const noexcept {
  if (isOpen()) return {};
  const char* text = ::strerrordesc_np(error_);
  return text == nullptr ? "cannot be bound" : text;
}

std::size_t UdpStream::read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept {
  if (!ready()) {
    ::poll(nullptr, 0, timeout_ms);
    return 0;
  }
  if (at_ == size_) {
    pollfd waiting = {socket_.descriptor(), POLLIN, 0};
    if (::poll(&waiting, 1, timeout_ms) != 1) return 0;
    UdpAddress sender;
    at_ = 0;
    size_ = socket_.receive(datagram_, sender).value_or(0);
  }
  const std::size_t count = std::min(buffer.size(), size_ - at_);
  std::memcpy(buffer.data(), datagram_.data() + at_, count);
  at_ += count;
  return count;
}

}  // namespace fathom::io

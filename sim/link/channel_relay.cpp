#include "sim/link/channel_relay.hpp"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "realtime/base/input_error.hpp"

namespace fathom::sim {
namespace {

constexpr int kLongestWaitMs = 200;  // between checks for signals and idleness

volatile std::sig_atomic_t stop_requested = 0;

void requestStop(int) {
  stop_requested = 1;
}

class Socket {
 public:
  explicit Socket(std::uint16_t port) : fd_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
    if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "UDP socket");
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_ANY);
    address.sin_port = htons(port);
    if (::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      const std::string reason = std::strerror(errno);
      ::close(fd_);
      throw InputError("--listen", std::to_string(port),
                       "this port cannot be used (" + reason + "); give a free one");
    }
  }
  ~Socket() { ::close(fd_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int fd() const { return fd_; }

  // Receives one datagram; its size, 0 for none. The buffer is one byte longer than a frame, so that the
  // channel refuses datagrams that are too long.
  std::size_t receive(std::span<std::uint8_t> buffer, sockaddr_in& from) const {
    socklen_t length = sizeof from;
    const ssize_t size =
        ::recvfrom(fd_, buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &length);
    return size > 0 ? static_cast<std::size_t>(size) : 0;
  }
  void send(std::span<const std::uint8_t> frame, const sockaddr_in& to) const {
    // While no receiver exists, frames are lost; that is no error.
    (void)::sendto(fd_, frame.data(), frame.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }

 private:
  int fd_;
};

sockaddr_in resolve(const std::string& host, std::uint16_t port) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (port == 0 || ::getaddrinfo(host.c_str(), nullptr, &hints, &found) != 0 || found == nullptr)
    throw InputError("--to", host + ":" + std::to_string(port),
                     "is no address that can be sent to; give HOST:PORT");
  sockaddr_in address{};
  std::memcpy(&address, found->ai_addr, sizeof address);
  ::freeaddrinfo(found);
  address.sin_port = htons(port);
  return address;
}

bool sameEnd(const sockaddr_in& a, const sockaddr_in& b) {
  return a.sin_addr.s_addr == b.sin_addr.s_addr && a.sin_port == b.sin_port;
}

double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void report(const char* name, const AcousticChannel::Counters& c) {
  std::fprintf(
      stderr,
      "simulated acoustic channel, %s: %llu frames offered, %llu refused, %llu lost, %llu duplicated, "
      "%llu reordered, %llu corrupted, %llu collided, %llu delivered\n",
      name, static_cast<unsigned long long>(c.offered), static_cast<unsigned long long>(c.refused),
      static_cast<unsigned long long>(c.lost), static_cast<unsigned long long>(c.duplicated),
      static_cast<unsigned long long>(c.reordered), static_cast<unsigned long long>(c.corrupted),
      static_cast<unsigned long long>(c.collided), static_cast<unsigned long long>(c.delivered));
}

}  // namespace

int runChannelRelay(const ChannelRelayOptions& options) {
  const sockaddr_in ship = resolve(options.to_host, options.to_port);
  ChannelConfig down_config = options.down;
  down_config.seed ^= AcousticChannel::kDownlinkStream;
  AcousticChannel up(options.channel), down(down_config);
  if (options.half_duplex) {
    up.loseWhileTransmitting(down);
    down.loseWhileTransmitting(up);
  }
  const Socket socket(options.listen_port);
  stop_requested = 0;
  struct sigaction action {};
  action.sa_handler = requestStop;
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);

  const auto start = std::chrono::steady_clock::now();
  sockaddr_in vehicle{};
  bool vehicle_known = false;
  double last_frame_s = 0;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes + 1> buffer{};
  while (stop_requested == 0) {
    double now_s = secondsSince(start);
    sockaddr_in from{};
    while (const std::size_t size = socket.receive(buffer, from)) {
      last_frame_s = now_s;
      const bool from_ship = sameEnd(from, ship);
      if (!from_ship) {
        vehicle = from;
        vehicle_known = true;
      }
      // The channel counts refused frames.
      (void)(from_ship ? down : up).send(now_s, std::span(buffer).first(size));
    }
    while (const std::size_t size = up.receive(now_s, buffer))
      socket.send(std::span(buffer).first(size), ship);
    while (const std::size_t size = down.receive(now_s, buffer))
      if (vehicle_known) socket.send(std::span(buffer).first(size), vehicle);

    double next_s = now_s + kLongestWaitMs * 1e-3;
    bool flying = false;
    for (const AcousticChannel* channel : {&up, &down}) {
      if (channel->nextArrival() < 0) continue;
      flying = true;
      next_s = std::min(next_s, channel->nextArrival());
    }
    if (options.idle_exit_s > 0 && !flying && now_s - last_frame_s >= options.idle_exit_s) break;
    now_s = secondsSince(start);
    pollfd waiting{socket.fd(), POLLIN, 0};
    // Rounded up: waking before the arrival would only spin.
    ::poll(&waiting, 1, std::clamp(static_cast<int>((next_s - now_s) * 1e3) + 1, 1, kLongestWaitMs));
  }
  report("up", up.counters());
  report("down", down.counters());
  return kExitSuccess;
}

}  // namespace fathom::sim

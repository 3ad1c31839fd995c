#include "sim/hil/gige/gige_sockets.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "realtime/base/input_error.hpp"

namespace fathom::sim {

sockaddr_in socketAddress(std::uint32_t address, std::uint16_t port) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(port);
  result.sin_addr.s_addr = htonl(address);
  return result;
}

GigeSocket::GigeSocket(std::uint32_t address, std::uint16_t port, const std::string& name)
    : fd_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
  const int on = 1;
  ::setsockopt(fd_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in own = socketAddress(address, port);
  if (fd_ >= 0 && ::bind(fd_, reinterpret_cast<const sockaddr*>(&own), sizeof own) == 0) return;
  const int error = errno;
  close();
  throw InputError("--interface", name, std::string("cannot be served: ") + std::strerror(error));
}

GigeSocket::~GigeSocket() {
  close();
}

void GigeSocket::close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

OwnNetwork networkOf(const std::string& address) {
  in_addr wanted{};
  if (::inet_pton(AF_INET, address.c_str(), &wanted) != 1)
    throw InputError("--interface", address, "is no IPv4 address; give the address to serve on");
  OwnNetwork network{.address = ntohl(wanted.s_addr)};
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) == 0) {
    for (const ifaddrs* i = list; i != nullptr; i = i->ifa_next) {
      if (i->ifa_addr == nullptr || i->ifa_addr->sa_family != AF_INET || i->ifa_netmask == nullptr) continue;
      if (reinterpret_cast<const sockaddr_in*>(i->ifa_addr)->sin_addr.s_addr == wanted.s_addr)
        network.mask = ntohl(reinterpret_cast<const sockaddr_in*>(i->ifa_netmask)->sin_addr.s_addr);
    }
    ::freeifaddrs(list);
  }
  network.broadcast = network.address | ~network.mask;
  return network;
}

}  // namespace fathom::sim

#include "sim/hil/gige/gige_packets.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "realtime/base/input_error.hpp"

namespace fathom::sim {
namespace {

constexpr std::uint8_t kKey = 0x42;          // every request begins with it
constexpr std::uint8_t kWantsAnswer = 0x01;  // flag
constexpr std::size_t kGvcpHeaderBytes = 8;
constexpr std::uint32_t kLeader = 1, kTrailer = 2, kData = 3;  // GVSP packet formats
constexpr std::uint16_t kImage = 1;                            // GVSP payload type

}  // namespace

std::optional<GvcpRequest> parseGvcp(std::span<const std::uint8_t> datagram) {
  if (datagram.size() < kGvcpHeaderBytes || datagram[0] != kKey) return std::nullopt;
  const std::size_t length = bigEndianAt<std::uint16_t>(datagram, 4);
  if (length > datagram.size() - kGvcpHeaderBytes) return std::nullopt;
  return GvcpRequest{.command = bigEndianAt<std::uint16_t>(datagram, 2),
                     .id = bigEndianAt<std::uint16_t>(datagram, 6),
                     .wants_answer = (datagram[1] & kWantsAnswer) != 0,
                     .payload = datagram.subspan(kGvcpHeaderBytes, length)};
}

std::vector<std::uint8_t> gvcpAnswer(const GvcpRequest& request, GvcpStatus status,
                                     std::span<const std::uint8_t> payload) {
  std::vector<std::uint8_t> out;
  appendBigEndian(out, static_cast<std::uint16_t>(status));
  appendBigEndian(
      out, static_cast<std::uint16_t>(request.command + 1));  // every answer is its request's number + 1
  appendBigEndian(out, static_cast<std::uint16_t>(payload.size()));
  appendBigEndian(out, request.id);
  out.insert(out.end(), payload.begin(), payload.end());
  return out;
}

void GvspFrame::packet(std::uint32_t n, std::vector<std::uint8_t>& out) const {
  out.clear();
  const std::uint32_t last = packets() - 1;
  appendBigEndian<std::uint16_t>(out, 0);  // status
  appendBigEndian(out, id);
  appendBigEndian<std::uint32_t>(out, (n == 0 ? kLeader : n == last ? kTrailer : kData) << 24 | n);
  if (n == 0) {
    appendBigEndian<std::uint16_t>(out, 0);
    appendBigEndian(out, kImage);
    appendBigEndian(out, ticks);
    for (const std::uint32_t field : {pixel_format, width, height, 0U, 0U}) appendBigEndian(out, field);
    appendBigEndian<std::uint32_t>(out, 0);  // padding of lines and of the image
  } else if (n == last) {
    appendBigEndian<std::uint16_t>(out, 0);
    appendBigEndian(out, kImage);
    appendBigEndian(out, height);
  } else {
    const std::size_t from = (n - 1) * data_bytes;
    const std::size_t to = std::min(from + data_bytes, image.size());
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(image.data());
    out.insert(out.end(), bytes + from, bytes + to);
  }
}

sockaddr_in socketAddress(std::uint32_t address, std::uint16_t port) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(port);
  result.sin_addr.s_addr = htonl(address);
  return result;
}

GigeSocket::GigeSocket(std::uint32_t address, std::uint16_t port, const std::string& name)
    : file_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
  const int on = 1;
  ::setsockopt(fd(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in own = socketAddress(address, port);
  if (!file_.open() || ::bind(fd(), reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0)
    throw InputError("--interface", name, std::string("cannot be served: ") + std::strerror(errno));
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

#pragma once

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

namespace fathom::uml {

// Another device on the bus: a raw socket without filters, written apart from the code under test.
class BusPeer {
 public:
  explicit BusPeer(const char* interface) : fd_(::socket(PF_CAN, SOCK_RAW, CAN_RAW)) {
    ifreq request = {};
    std::strncpy(request.ifr_name, interface, IFNAMSIZ - 1);
    sockaddr_can address = {};
    address.can_family = AF_CAN;
    if (::ioctl(fd_, SIOCGIFINDEX, &request) != 0) std::abort();
    address.can_ifindex = request.ifr_ifindex;
    if (::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) std::abort();
  }
  ~BusPeer() { ::close(fd_); }
  BusPeer(const BusPeer&) = delete;
  BusPeer& operator=(const BusPeer&) = delete;

  // `id` with the flags of linux/can.h.
  bool send(std::uint32_t id, const std::vector<std::uint8_t>& data) {
    can_frame frame = {};
    frame.can_id = id;
    frame.len = static_cast<std::uint8_t>(data.size());
    std::copy(data.begin(), data.end(), frame.data);
    return ::write(fd_, &frame, sizeof frame) == sizeof frame;
  }
  bool send(std::uint32_t pgn, std::uint8_t source, const std::vector<std::uint8_t>& data) {
    return send((3U << 26) | (pgn << 8) | source | CAN_EFF_FLAG, data);
  }
  std::optional<can_frame> receive(int timeout_ms) {
    pollfd socket = {fd_, POLLIN, 0};
    can_frame frame = {};
    if (::poll(&socket, 1, timeout_ms) != 1 || ::read(fd_, &frame, sizeof frame) != sizeof frame)
      return std::nullopt;
    return frame;
  }

 private:
  int fd_;
};

}  // namespace fathom::uml

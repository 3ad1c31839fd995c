#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <string>
#include <utility>

namespace fathom::sim {

// A UDP socket bound to an address [host order]. Throws InputError naming `name` when it cannot be bound.
class GigeSocket {
 public:
  GigeSocket() = default;
  GigeSocket(std::uint32_t address, std::uint16_t port, const std::string& name);
  ~GigeSocket();
  GigeSocket(GigeSocket&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  GigeSocket& operator=(GigeSocket&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  [[nodiscard]] int fd() const { return fd_; }

 private:
  void close();
  int fd_ = -1;
};

[[nodiscard]] sockaddr_in socketAddress(std::uint32_t address, std::uint16_t port);

// The network of an own address [host order].
struct OwnNetwork {
  std::uint32_t address = 0, mask = 0xffffff00, broadcast = 0;
};
// Throws InputError for text that is no IPv4 address.
[[nodiscard]] OwnNetwork networkOf(const std::string& address);

}  // namespace fathom::sim

#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "firmware_if/devices/byte_stream.hpp"

namespace fathom::io {

// The bytes of the datagrams that come to a port, from whoever sends. Listens on one of this machine's
// addresses, or 0.0.0.0 for all of them.
class UdpStream final : public ByteStream {
 public:
  // Throws InputError for an address that is none or is taken. Port 0: any.
  UdpStream(const std::string& address, std::uint16_t port);
  ~UdpStream() override;
  UdpStream(const UdpStream&) = delete;
  UdpStream& operator=(const UdpStream&) = delete;

  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept override;
  [[nodiscard]] bool isOpen() const noexcept override { return true; }
  [[nodiscard]] std::uint64_t disconnects() const noexcept override { return 0; }
  [[nodiscard]] std::uint16_t port() const noexcept { return port_; }

 private:
  int socket_ = -1;
  std::uint16_t port_ = 0;
  std::array<std::uint8_t, 65536> datagram_;  // the largest that there is
  std::size_t size_ = 0, at_ = 0;             // of the datagram under way
};

}  // namespace fathom::io

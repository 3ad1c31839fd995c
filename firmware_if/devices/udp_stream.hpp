#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "firmware_if/devices/byte_stream.hpp"
#include "realtime/kernel/retry_wait.hpp"

namespace fathom::io {

// The bytes of the datagrams that come to a port, from whoever sends. Listens on one of this machine's
// addresses, or 0.0.0.0 for all of them. One that cannot be listened on now (its interface is not up, another
// program has the port) is tried again after 1, 2, 4... 16 s.
class UdpStream final : public ByteStream {
 public:
  // Throws InputError for an address that is none. Port 0: any.
  UdpStream(const std::string& address, std::uint16_t port, std::int64_t first_wait_ns = 1'000'000'000);
  ~UdpStream() override;
  UdpStream(const UdpStream&) = delete;
  UdpStream& operator=(const UdpStream&) = delete;

  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept override;
  [[nodiscard]] bool isOpen() const noexcept override { return socket_ >= 0; }
  [[nodiscard]] std::string_view reason() const noexcept override;
  [[nodiscard]] std::uint64_t disconnects() const noexcept override { return 0; }
  [[nodiscard]] std::uint16_t port() const noexcept { return port_; }  // once it is open

 private:
  bool ready() noexcept;

  std::uint32_t ipv4_ = 0;  // network byte order
  std::uint16_t port_ = 0;
  int socket_ = -1;
  int error_ = 0;  // errno of the last try
  rt::RetryWait wait_;
  std::array<std::uint8_t, 65536> datagram_;  // the largest that there is
  std::size_t size_ = 0, at_ = 0;             // of the datagram under way
};

}  // namespace fathom::io

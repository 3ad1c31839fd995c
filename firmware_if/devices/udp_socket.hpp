#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "firmware_if/devices/byte_stream.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {

struct UdpAddress {
  std::uint32_t ipv4 = 0;  // network byte order
  std::uint16_t port = 0;
  friend bool operator==(const UdpAddress&, const UdpAddress&) = default;
};
// Throws InputError for a text that is no numeric IPv4 address, with `where` as the file's name.
[[nodiscard]] UdpAddress parseUdpAddress(const std::string& ipv4, std::uint16_t port,
                                         const std::string& where = "UDP address");

// A UDP socket bound to an address of this machine; never blocks.
class UdpSocket {
 public:
  // Opens and binds to `local` (0.0.0.0: every interface; port 0: any free one). 0, or the errno.
  [[nodiscard]] int bind(const UdpAddress& local) noexcept;
  [[nodiscard]] bool isOpen() const noexcept { return socket_.open(); }
  [[nodiscard]] int descriptor() const noexcept { return socket_.get(); }
  [[nodiscard]] std::uint16_t port() const noexcept { return port_; }  // bound to

  // The next datagram, cut to the size of `buffer`, and its sender: its size; std::nullopt when none waits.
  [[nodiscard]] std::optional<std::size_t> receive(std::span<std::uint8_t> buffer,
                                                   UdpAddress& sender) noexcept;
  [[nodiscard]] bool send(std::span<const std::uint8_t> datagram, const UdpAddress& to) noexcept;

 private:
  Descriptor socket_;
  std::uint16_t port_ = 0;
};

// The bytes of the datagrams that come to a port, from any sender. Listens on one of this machine's
// addresses, or 0.0.0.0 for all of them. A port that cannot be listened on now (its interface is not up,
// another program has it) is tried again after 1, 2, 4... 16 s.
class UdpStream final : public ByteStream {
 public:
  // Throws InputError for a text that is no numeric IPv4 address. Port 0: any.
  UdpStream(const std::string& address, std::uint16_t port, std::int64_t first_wait_ns = kSecond_ns);

  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept override;
  [[nodiscard]] bool isOpen() const noexcept override { return socket_.isOpen(); }
  [[nodiscard]] std::string_view reason() const noexcept override;
  [[nodiscard]] std::uint64_t disconnects() const noexcept override { return 0; }
  [[nodiscard]] std::uint16_t port() const noexcept { return socket_.port(); }  // once it is open

 private:
  bool ready() noexcept;

  UdpAddress local_;
  UdpSocket socket_;
  int error_ = 0;  // errno of the last try
  rt::RetryWait wait_;
  std::array<std::uint8_t, 65536> datagram_;  // the largest that there is
  std::size_t size_ = 0, at_ = 0;             // of the datagram being read
};

}  // namespace fathom::io

#pragma once

#include <netinet/in.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/files/descriptor.hpp"

namespace fathom::sim {

// Packets of the control protocol GVCP and the stream protocol GVSP (GigE Vision 1.2, sections 14 to 24) on
// the camera's side.

enum class GvcpCommand : std::uint16_t {
  kDiscovery = 0x0002,
  kPacketResend = 0x0040,
  kReadRegisters = 0x0080,
  kWriteRegisters = 0x0082,
  kReadMemory = 0x0084,
  kWriteMemory = 0x0086,
};

enum class GvcpStatus : std::uint16_t {
  kSuccess = 0x0000,
  kNotImplemented = 0x8001,
  kInvalidParameter = 0x8002,
  kInvalidAddress = 0x8003,
  kWriteProtect = 0x8004,
  kAccessDenied = 0x8006,
};

struct GvcpRequest {
  std::uint16_t command = 0;
  std::uint16_t id = 0;
  bool wants_answer = false;
  std::span<const std::uint8_t> payload;  // into the datagram
};

// std::nullopt for other data and for truncated requests.
[[nodiscard]] std::optional<GvcpRequest> parseGvcp(std::span<const std::uint8_t> datagram);
[[nodiscard]] std::vector<std::uint8_t> gvcpAnswer(const GvcpRequest& request, GvcpStatus status,
                                                   std::span<const std::uint8_t> payload);

// Appends a number, highest byte first.
template <class Unsigned>
void appendBigEndian(std::vector<std::uint8_t>& out, Unsigned value) {
  out.resize(out.size() + sizeof value);
  writeBigEndian(std::span(out).last(sizeof value), value);
}

// A frame as packets: leader, data, trailer.
struct GvspFrame {
  std::uint16_t id = 0;
  std::uint64_t ticks = 0;  // time stamp
  std::uint32_t pixel_format = 0;
  std::uint32_t width = 0, height = 0;
  std::size_t data_bytes = 0;  // of a data packet
  std::vector<std::byte> image;

  [[nodiscard]] std::uint32_t packets() const {
    return static_cast<std::uint32_t>((image.size() + data_bytes - 1) / data_bytes) + 2;
  }
  // Writes packet `n` of packets() into `out`, without IP and UDP headers.
  void packet(std::uint32_t n, std::vector<std::uint8_t>& out) const;
};

// Bytes of IP, UDP and GVSP headers, included in the packet size register.
inline constexpr std::size_t kGvspOverhead = 20 + 8 + 8;
inline constexpr std::size_t kUdpOverhead = 20 + 8;

// A UDP socket bound to an address [host order]. Throws InputError naming `name` when it cannot be bound.
class GigeSocket {
 public:
  GigeSocket() = default;
  GigeSocket(std::uint32_t address, std::uint16_t port, const std::string& name);
  [[nodiscard]] int fd() const { return file_.get(); }

 private:
  Descriptor file_;
};

[[nodiscard]] sockaddr_in socketAddress(std::uint32_t address, std::uint16_t port);

// The network of an own address [host order].
struct OwnNetwork {
  std::uint32_t address = 0, mask = 0xffffff00, broadcast = 0;
};
// Throws InputError for text that is no IPv4 address.
[[nodiscard]] OwnNetwork networkOf(const std::string& address);

}  // namespace fathom::sim

#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware_if/modem/slip.hpp"
#include "realtime/kernel/frame_port.hpp"

namespace fathom::io {

// UDP stand-in for the modem: one datagram is one frame. Addresses are numeric IPv4.
class UdpFramePort final : public FramePort {
 public:
  // Binds `bind_port` (0: any) on `bind_address`; frames go to `peer_address:peer_port` (port 0: receive
  // only). Throws InputError for an address that cannot be used.
  UdpFramePort(const std::string& bind_address, std::uint16_t bind_port, const std::string& peer_address,
               std::uint16_t peer_port);
  ~UdpFramePort() override;
  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> buffer) noexcept override;
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return dropped_; }
  [[nodiscard]] std::uint16_t boundPort() const noexcept { return bound_port_; }

 private:
  int socket_ = -1;
  std::uint16_t bound_port_ = 0;
  bool has_peer_ = false;
  std::uint32_t peer_ipv4_ = 0;  // network byte order
  std::uint16_t peer_port_ = 0;
  std::uint64_t dropped_ = 0;
};

// A transparent serial port to the modem (LinkQuest style). Frames are delimited and escaped on the line
// (SLIP, RFC 1055) so that a lost byte damages one frame only; never blocks. A frame that the device takes
// only in part is continued by the next call of either kind; send() returns false until it has gone.
class SerialFramePort final : public FramePort {
 public:
  // Opens `device` raw, 8N1 at `baud`. Throws InputError for a device or rate that cannot be used.
  SerialFramePort(const std::string& device, int baud);
  ~SerialFramePort() override;
  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> buffer) noexcept override;
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override {
    return dropped_ + decoder_.dropped();
  }

 private:
  bool drain() noexcept;

  int fd_ = -1;
  std::array<std::uint8_t, kMaxSlipBytes> line_ = {};  // the frame under way to the device
  std::size_t line_size_ = 0, line_sent_ = 0;
  std::array<std::uint8_t, kMaxSlipBytes> input_ = {};  // bytes read, not yet decoded
  std::size_t input_size_ = 0, input_at_ = 0;
  SlipDecoder decoder_;
  std::uint64_t dropped_ = 0;  // beyond those that the decoder dropped
};

}  // namespace fathom::io

#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "realtime/kernel/frame_port.hpp"

namespace fathom::io {

// UDP stand-in for the modem: one datagram is one frame.
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
  std::uint64_t dropped_ = 0;
};

// A transparent serial port to the modem (LinkQuest style). Frames are delimited and escaped on the line
// (SLIP, RFC 1055) so that a lost byte damages one frame only; never blocks.
class SerialFramePort final : public FramePort {
 public:
  // Opens `device` raw, 8N1 at `baud`. Throws InputError for a device or rate that cannot be used.
  SerialFramePort(const std::string& device, int baud);
  ~SerialFramePort() override;
  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> buffer) noexcept override;
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return dropped_; }

 private:
  int fd_ = -1;
  std::uint64_t dropped_ = 0;
};

}  // namespace fathom::io

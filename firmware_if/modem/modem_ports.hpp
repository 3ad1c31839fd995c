#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware_if/modem/slip.hpp"
#include "firmware_if/serial/serial_line.hpp"
#include "realtime/kernel/frame_port.hpp"

namespace fathom::io {

// UDP stand-in for the modem: one datagram is one frame. Addresses are numeric IPv4. With a peer, only its
// datagrams are heard; without one, all are, and the sender of the last one that was found to be true is
// answered (answerHeard()): whoever can send a datagram must not lead away what goes to the vehicle.
class UdpFramePort final : public FramePort {
 public:
  // Binds `bind_port` (0: any) on `bind_address`; frames go to `peer_address:peer_port` (port 0: to
  // nobody before answerHeard()). Throws InputError for an address that cannot be used.
  UdpFramePort(const std::string& bind_address, std::uint16_t bind_port, const std::string& peer_address,
               std::uint16_t peer_port);
  ~UdpFramePort() override;
  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> buffer) noexcept override;
  void answerHeard() noexcept override;
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return dropped_; }
  [[nodiscard]] std::uint16_t boundPort() const noexcept { return bound_port_; }

 private:
  int socket_ = -1;
  std::uint16_t bound_port_ = 0;
  bool peer_given_ = false;
  struct Address {
    std::uint32_t ipv4 = 0;  // network byte order
    std::uint16_t port = 0;  // 0: nobody
    friend bool operator==(const Address&, const Address&) = default;
  };
  Address peer_, heard_;  // who is sent to; who spoke last
  std::uint64_t dropped_ = 0;
};

// A transparent serial port to the modem (LinkQuest style). Frames are delimited and escaped on the line
// (SLIP, RFC 1055) so that a lost byte damages one frame only; never blocks. A frame that the device takes
// only in part is continued by the next call of either kind; send() returns false until it has gone. When the
// device goes away (unplugged, modem restarted) the port tries to open it again, at most every
// `reopen_interval_s`, and goes on; the frame under way is lost.
class SerialFramePort final : public FramePort {
 public:
  // Opens `device` raw, 8N1 at `baud`. Throws InputError for a device or rate that cannot be used.
  SerialFramePort(const std::string& device, int baud, double reopen_interval_s = 1.0);
  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> buffer) noexcept override;
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override {
    return dropped_ + decoder_.dropped();
  }
  [[nodiscard]] bool isOpen() const noexcept override { return serial_.isOpen(); }
  [[nodiscard]] std::string_view reason() const noexcept override { return serial_.reason(); }
  // How often the device has gone away.
  [[nodiscard]] std::uint64_t disconnects() const noexcept { return serial_.disconnects(); }

 private:
  bool drain() noexcept;
  // Whether the device is there; forgets what was under way when it was opened again.
  bool ready() noexcept;

  SerialLine serial_;
  std::uint64_t connection_ = 0;                       // of the line that the buffers below are of
  std::array<std::uint8_t, kMaxSlipBytes> line_ = {};  // the frame under way to the device
  std::size_t line_size_ = 0, line_sent_ = 0;
  std::array<std::uint8_t, kMaxSlipBytes> input_ = {};  // bytes read, not yet decoded
  std::size_t input_size_ = 0, input_at_ = 0;
  SlipDecoder decoder_;
  std::uint64_t dropped_ = 0;  // beyond those that the decoder dropped
};

}  // namespace fathom::io

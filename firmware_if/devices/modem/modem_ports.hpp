#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "firmware_if/devices/serial/serial_line.hpp"
#include "firmware_if/devices/udp_socket.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/frame_port.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {

// SLIP (RFC 1055): a frame ends with END (0xC0); END and ESC inside it travel as two bytes. An END goes out
// before each frame too, so that line noise ends in a frame of its own. The line protocol only finds frames;
// the CRC inside them says whether they are undamaged.
constexpr std::size_t kMaxSlipBytes = 2 * FramePort::kMaxFrameBytes + 2;

// Encodes `frame` into `out` (at least kMaxSlipBytes) and returns the bytes used; 0 for an empty or too long
// frame.
[[nodiscard]] std::size_t slipEncode(std::span<const std::uint8_t> frame,
                                     std::span<std::uint8_t> out) noexcept;

// Takes the bytes of a line one by one. Fixed memory.
class SlipDecoder {
 public:
  // True when `byte` ends a frame, which is then in frame() until the next call. Empty frames are passed
  // over; frames that are too long or hold a false escape are dropped and counted.
  [[nodiscard]] bool push(std::uint8_t byte) noexcept;
  // Forgets a frame that has begun, and counts it as dropped.
  void restart() noexcept;
  [[nodiscard]] std::span<const std::uint8_t> frame() const noexcept { return {frame_.data(), finished_}; }
  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_; }

 private:
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> frame_ = {};
  std::size_t size_ = 0, finished_ = 0;
  bool escaped_ = false;
  bool broken_ = false;
  std::uint64_t dropped_ = 0;
};

// UDP stand-in for the modem: one datagram is one frame. Addresses are numeric IPv4. With a peer, only its
// datagrams are received. Without one, all are, and the sender of the last valid frame is answered
// (answerLastSender()), so that a forged datagram does not lead away what goes to the vehicle.
class UdpFramePort final : public FramePort {
 public:
  // Binds `bind_port` (0: any) on `bind_address`; frames go to `peer_address:peer_port` (port 0: to nobody
  // before answerLastSender()). Throws InputError for an address that cannot be used.
  UdpFramePort(const std::string& bind_address, std::uint16_t bind_port, const std::string& peer_address,
               std::uint16_t peer_port);
  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> buffer) noexcept override;
  void answerLastSender() noexcept override;
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return dropped_; }
  [[nodiscard]] std::uint16_t boundPort() const noexcept { return socket_.port(); }

 private:
  UdpSocket socket_;
  bool peer_given_ = false;
  UdpAddress peer_, last_sender_;  // port 0: none
  std::uint64_t dropped_ = 0;
};

// A transparent serial port to the modem (LinkQuest style). Frames are delimited and escaped on the line
// (SLIP, RFC 1055) so that a lost byte damages one frame only; never blocks. A frame that the device takes
// only in part is continued by the next call of either kind; send() returns false until it has gone. When the
// device goes away (unplugged, modem restarted) the port tries to open it again, at most every
// `reopen_interval_s`; a frame half sent or half received is lost.
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
  // Whether the device is there; when it was opened again, frames half sent or half received are dropped.
  bool ready() noexcept;

  SerialLine serial_;
  std::uint64_t connection_ = 0;                       // of the line that the buffers below are of
  std::array<std::uint8_t, kMaxSlipBytes> line_ = {};  // the frame being sent
  std::size_t line_size_ = 0, line_sent_ = 0;
  std::array<std::uint8_t, kMaxSlipBytes> input_ = {};  // bytes read, not yet decoded
  std::size_t input_size_ = 0, input_at_ = 0;
  SlipDecoder decoder_;
  std::uint64_t dropped_ = 0;  // beyond those that the decoder dropped
};

// The port of a modem that need not be there yet: opened by itself, at once and then after 1, 2, 4... 16 s.
// Until then send() refuses and nothing comes. Once open, the port looks after its device itself. One thread
// uses it.
class WaitingFramePort final : public FramePort {
 public:
  static constexpr std::int64_t kFirstWaitNs = kSecond_ns, kLongestWaitNs = 16 * kSecond_ns;
  using Open = std::function<std::unique_ptr<FramePort>()>;  // throws while the device cannot be used

  explicit WaitingFramePort(Open open, std::int64_t first_wait_ns = kFirstWaitNs);

  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> buffer) noexcept override;
  void answerLastSender() noexcept override;
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override;
  [[nodiscard]] bool isOpen() const noexcept override;
  [[nodiscard]] std::string_view reason() const noexcept override;

 private:
  bool ready() noexcept;

  Open open_;
  std::unique_ptr<FramePort> port_;
  rt::RetryWait wait_;
  std::string reason_;
};

}  // namespace fathom::io

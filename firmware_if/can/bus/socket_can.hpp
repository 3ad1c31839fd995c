#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "firmware_if/can/bus/can_errors.hpp"
#include "firmware_if/can/can_frame.hpp"
#include "firmware_if/devices/receive_time.hpp"
#include "realtime/kernel/clock.hpp"

struct can_filter;

namespace fathom::io {

// What the socket gave: a data frame, or what the controller says (then frame.id holds the error classes).
struct BusFrame {
  CanFrame frame;  // frame.utc_ns: vehicle time of reception, always there
  bool error = false;
};

// A raw SocketCAN socket on one interface. The kernel passes only 29-bit data frames of the given parameter
// groups, and error frames. Never blocks but in receive(), never throws after construction, allocates
// nothing.
//
// An interface that is absent, goes down or is removed closes the socket; receive() opens it again when it is
// back, at most once a second. The interface's bit rate and restart from bus-off are the system's to set (ip
// link set can0 type can bitrate 250000 restart-ms 100).
class SocketCan {
 public:
  struct Counts {
    std::uint64_t frames = 0;        // data frames received
    std::uint64_t ill_formed = 0;    // of a kind or length that was not asked for
    std::uint64_t kernel_drops = 0;  // frames that the kernel dropped because nobody read them in time
    std::uint64_t disconnects = 0;
    std::uint64_t sent = 0;
  };
  static constexpr std::size_t kBatch = 64;

  // `vehicle`: its utcNs() is vehicle time, which never steps. Throws InputError for an interface name that
  // cannot be one. An interface that is not there yet is none: isOpen() tells.
  SocketCan(std::string interface, std::span<const std::uint32_t> pgns, const rt::Clock& vehicle);
  ~SocketCan();
  SocketCan(const SocketCan&) = delete;
  SocketCan& operator=(const SocketCan&) = delete;

  // Waits at most `timeout_ms` and gives up to kBatch frames that came, in order, valid until the next call.
  [[nodiscard]] std::span<const BusFrame> receive(int timeout_ms) noexcept;
  // False when the frame cannot go now: not open, or the interface's queue is full.
  [[nodiscard]] bool send(const CanFrame& frame) noexcept;

  [[nodiscard]] bool isOpen() const noexcept { return fd_ >= 0; }
  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }
  [[nodiscard]] const CanErrors& errors() const noexcept { return errors_; }
  [[nodiscard]] std::uint64_t clockSteps() const noexcept { return receive_time_.clockSteps(); }

 private:
  enum class Read { kFrame, kSkipped, kNothing };
  void open() noexcept;
  void close() noexcept;
  void drained() noexcept;
  [[nodiscard]] Read read(BusFrame& out) noexcept;

  std::string interface_;
  std::vector<can_filter> filters_;
  const rt::Clock& vehicle_;
  ReceiveTime receive_time_;
  int fd_ = -1;
  std::int64_t next_open_ns_ = 0;   // monotonic
  std::uint32_t socket_drops_ = 0;  // of this socket, as the kernel counts them
  std::array<BusFrame, kBatch> batch_{};
  CanErrors errors_;
  Counts counts_;
};

}  // namespace fathom::io

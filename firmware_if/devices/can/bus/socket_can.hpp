#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "firmware_if/devices/can/can_frame.hpp"
#include "firmware_if/devices/vehicle_time.hpp"
#include "realtime/kernel/time/clock.hpp"

struct can_filter;

namespace fathom::io {

// What the CAN controller says through error frames (linux/can/error.h), counted by kind.
class CanErrors {
 public:
  enum Kind : std::uint8_t {
    kTxTimeout,
    kLostArbitration,
    kControllerOverflow,  // the controller lost frames for want of room
    kErrorWarning,        // 96 errors and more on either side
    kErrorPassive,        // 128 errors and more: the controller no longer disturbs the bus
    kProtocol,
    kTransceiver,
    kNoAcknowledge,  // nobody else is on the bus, or the wire is broken
    kBusOff,         // 256 send errors: the controller left the bus
    kBusError,
    kRestarted,  // after bus-off
    kKinds,
  };
  [[nodiscard]] static std::string_view name(Kind kind) noexcept;

  // `classes`: the identifier of the error frame without flags; `data` its bytes, as many as there are.
  void add(std::uint32_t classes, std::span<const std::uint8_t> data) noexcept;
  // A data frame came: the controller takes part in the bus.
  void alive() noexcept { bus_off_ = false; }

  [[nodiscard]] bool busOff() const noexcept { return bus_off_; }
  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }
  [[nodiscard]] std::uint64_t count(Kind kind) const noexcept { return counts_[kind]; }

 private:
  std::uint64_t frames_ = 0;
  std::array<std::uint64_t, kKinds> counts_{};
  bool bus_off_ = false;
};

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
  // cannot be one; one that is not there yet leaves the socket closed.
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

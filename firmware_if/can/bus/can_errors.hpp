#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "firmware_if/can/can_frame.hpp"

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

}  // namespace fathom::io

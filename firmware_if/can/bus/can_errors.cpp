#include "firmware_if/can/bus/can_errors.hpp"

#include <linux/can/error.h>

namespace fathom::io {

std::string_view CanErrors::name(Kind kind) noexcept {
  constexpr std::array<std::string_view, kKinds> kNames = {
      "tx_timeout",     "lost_arbitration",  "controller_overflow", "error_warning", "error_passive",
      "protocol_error", "transceiver_error", "no_acknowledge",      "bus_off",       "bus_error",
      "restarted"};
  return kNames[kind];
}

void CanErrors::add(std::uint32_t classes, std::span<const std::uint8_t> data) noexcept {
  ++frames_;
  const auto note = [&](bool so, Kind kind) { counts_[kind] += so ? 1 : 0; };
  const auto byte = [&](std::size_t at) { return at < data.size() ? data[at] : std::uint8_t{0}; };
  note((classes & CAN_ERR_TX_TIMEOUT) != 0, kTxTimeout);
  note((classes & CAN_ERR_LOSTARB) != 0, kLostArbitration);
  if ((classes & CAN_ERR_CRTL) != 0) {
    const std::uint8_t controller = byte(1);
    note((controller & (CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_OVERFLOW)) != 0, kControllerOverflow);
    note((controller & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0, kErrorWarning);
    note((controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0, kErrorPassive);
    if ((controller & CAN_ERR_CRTL_ACTIVE) != 0) bus_off_ = false;
  }
  note((classes & CAN_ERR_PROT) != 0, kProtocol);
  note((classes & CAN_ERR_TRX) != 0, kTransceiver);
  note((classes & CAN_ERR_ACK) != 0, kNoAcknowledge);
  note((classes & CAN_ERR_BUSERROR) != 0, kBusError);
  if ((classes & CAN_ERR_BUSOFF) != 0) {
    note(true, kBusOff);
    bus_off_ = true;
  }
  if ((classes & CAN_ERR_RESTARTED) != 0) {
    note(true, kRestarted);
    bus_off_ = false;
  }
}

}  // namespace fathom::io

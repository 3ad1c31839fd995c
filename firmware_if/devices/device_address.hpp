#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "firmware_if/devices/byte_stream.hpp"
#include "firmware_if/devices/modem/modem_ports.hpp"
#include "realtime/base/config_keys.hpp"

namespace fathom::io {

// Where a device is, as configuration files and command lines say it:
//   serial:DEVICE:BAUD   a serial line, as serial:/dev/ttyS1:115200
//   udp:HOST:PORT        a numeric IPv4 address: of the peer for a modem, to listen on for a DVL
//   file:PATH            a capture (DVL only)
struct DeviceAddress {
  enum class Kind { kSerial, kUdp, kFile };
  Kind kind = Kind::kSerial;
  std::string name;  // device, host or path
  int number = 0;    // baud rate or port; 0 for a file
};

// std::nullopt for a text of another form; then `fix` says what is wrong with it.
[[nodiscard]] std::optional<DeviceAddress> parseDeviceAddress(std::string_view text, std::string& fix);

// A key that holds such an address, checked down to the baud rate but not opened; may be empty.
void visitDeviceAddress(KeyVisitor& keys, const char* key, std::string& text, bool file_allowed,
                        const char* meaning);
// The keys of [modem]: its address.
void visitModem(KeyVisitor& keys, std::string& address);

// The modem at an address (serial or UDP); one that is not there is waited for. Throws InputError for an
// address or a baud rate that can never be used, with `where` ("--modem udp:1") as the file's name.
[[nodiscard]] std::unique_ptr<WaitingFramePort> openFramePort(const std::string& text,
                                                              const std::string& where);

// The bytes at an address. A serial line or a port that is not there is waited for; throws InputError for an
// address or a baud rate that can never be used, a file that is absent.
[[nodiscard]] std::unique_ptr<ByteStream> openByteStream(const DeviceAddress& address);

}  // namespace fathom::io

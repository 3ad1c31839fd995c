#include "firmware_if/devices/device_address.hpp"

#include <charconv>

#include "firmware_if/devices/serial/serial_line.hpp"
#include "firmware_if/devices/udp_socket.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::io {

std::optional<DeviceAddress> parseDeviceAddress(std::string_view text, std::string& fix) {
  const auto refuse = [&](const char* why) {
    fix = why;
    return std::nullopt;
  };
  const std::size_t first = text.find(':');
  if (first == std::string_view::npos) return refuse("give udp:HOST:PORT or serial:DEVICE:BAUD");
  const std::string_view kind = text.substr(0, first);
  if (kind == "file") {
    if (first + 1 == text.size()) return refuse("name the file, as file:dive.pd0");
    return DeviceAddress{DeviceAddress::Kind::kFile, std::string(text.substr(first + 1)), 0};
  }
  const std::size_t last = text.rfind(':');
  if (last == first || last == first + 1) return refuse("give udp:HOST:PORT or serial:DEVICE:BAUD");
  if (kind != "serial" && kind != "udp") return refuse("unknown kind of device; give udp: or serial:");
  DeviceAddress address{kind == "udp" ? DeviceAddress::Kind::kUdp : DeviceAddress::Kind::kSerial,
                        std::string(text.substr(first + 1, last - first - 1)), 0};
  const std::string_view digits = text.substr(last + 1);
  const auto parsed = std::from_chars(digits.data(), digits.data() + digits.size(), address.number);
  if (digits.empty() || parsed.ec != std::errc{} || parsed.ptr != digits.data() + digits.size())
    return refuse("the part after the last colon must be a number");
  if (address.kind == DeviceAddress::Kind::kUdp && (address.number < 1 || address.number > UINT16_MAX))
    return refuse("the UDP port must be 1 to 65535");
  return address;
}

void visitDeviceAddress(KeyVisitor& keys, const char* key, std::string& text, bool file_allowed,
                        const char* meaning) {
  keys.text(key, text, meaning);
  if (text.empty()) return;
  std::string fix;
  const auto address = parseDeviceAddress(text, fix);
  keys.require(address.has_value(), key, fix);
  if (!address) return;
  keys.require(address->kind != DeviceAddress::Kind::kFile || file_allowed, key,
               "give udp:HOST:PORT or serial:DEVICE:BAUD");
  keys.require(address->kind != DeviceAddress::Kind::kSerial || SerialLine::knownRate(address->number), key,
               std::to_string(address->number) + " baud is not one of " + SerialLine::rates());
}

void visitModem(KeyVisitor& keys, std::string& address) {
  visitDeviceAddress(keys, "device", address, false,
                     "serial:DEVICE:BAUD or udp:HOST:PORT, live; empty: none");
}

std::unique_ptr<WaitingFramePort> openFramePort(const std::string& text, const std::string& where) {
  std::string fix;
  const auto address = parseDeviceAddress(text, fix);
  if (!address) throw InputError(where, "", fix);
  const std::string name = address->name;
  const int number = address->number;
  switch (address->kind) {
    case DeviceAddress::Kind::kSerial:
      if (!SerialLine::knownRate(number))
        throw InputError(where, "", std::to_string(number) + " baud is not one of " + SerialLine::rates());
      return std::make_unique<WaitingFramePort>(
          [name, number] { return std::make_unique<SerialFramePort>(name, number); });
    case DeviceAddress::Kind::kUdp:
      static_cast<void>(parseUdpAddress(name, 0, where));
      return std::make_unique<WaitingFramePort>([name, number] {
        return std::make_unique<UdpFramePort>("0.0.0.0", 0, name, static_cast<std::uint16_t>(number));
      });
    case DeviceAddress::Kind::kFile:
      break;
  }
  throw InputError(where, "", "a modem is no file; give udp:HOST:PORT or serial:DEVICE:BAUD");
}

std::unique_ptr<ByteStream> openByteStream(const DeviceAddress& address) {
  switch (address.kind) {
    case DeviceAddress::Kind::kSerial:
      return std::make_unique<SerialLine>(address.name, address.number, SerialLine::IfAbsent::kWait);
    case DeviceAddress::Kind::kUdp:
      return std::make_unique<UdpStream>(address.name, static_cast<std::uint16_t>(address.number));
    case DeviceAddress::Kind::kFile:
      break;
  }
  return std::make_unique<FileStream>(address.name);
}

}  // namespace fathom::io

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "firmware_if/devices/byte_stream.hpp"

namespace fathom::io {

// A serial line, raw, 8N1, without flow control, that never blocks: reads give what is there (VMIN and VTIME
// 0; poll waits). Where the driver has it, ASYNC_LOW_LATENCY hands bytes over as they come instead of by a
// timer (16 ms in USB adapters). No other process can use the line: TIOCEXCL, and flock() against those with
// the same privileges. A line that goes away (unplugged, hung up) is opened again at most once every
// `reopen_interval_s`. One thread uses it.
class SerialLine final : public ByteStream {
 public:
  enum class IfAbsent { kRefuse, kWait };

  // Throws InputError for a rate that is no standard one and, with kRefuse, for a device that cannot be used
  // now.
  SerialLine(const std::string& device, int baud, IfAbsent if_absent, double reopen_interval_s = 1.0);
  ~SerialLine() override;
  SerialLine(const SerialLine&) = delete;
  SerialLine& operator=(const SerialLine&) = delete;

  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept override;
  // Writes what the device takes now and returns how many bytes.
  [[nodiscard]] std::size_t write(std::span<const std::uint8_t> bytes) noexcept;
  // Whether the device is there: notices when it goes, opens it again when it is back.
  bool ready() noexcept;
  [[nodiscard]] bool isOpen() const noexcept override { return fd_ >= 0; }
  [[nodiscard]] std::string_view reason() const noexcept override;
  [[nodiscard]] std::uint64_t disconnects() const noexcept override { return disconnects_; }
  // Times that it was opened: what came before the last is of another connection.
  [[nodiscard]] std::uint64_t connections() const noexcept { return connections_; }

  [[nodiscard]] static bool knownRate(int baud) noexcept;
  [[nodiscard]] static std::string rates();  // "300, 600, ..."

 private:
  enum class Failure { kNone, kOpen, kNoTerminal, kTaken, kRate };
  Failure open() noexcept;
  Failure tryToOpen() noexcept;
  void lose() noexcept;

  std::string device_;
  unsigned rate_code_ = 0;  // termios' code of the baud rate
  std::int64_t reopen_interval_ns_ = 0, next_open_ns_ = 0;
  int fd_ = -1;
  int error_ = 0;                     // errno of the open that failed
  Failure failure_ = Failure::kNone;  // of the last open
  std::uint64_t disconnects_ = 0, connections_ = 0;
};

}  // namespace fathom::io

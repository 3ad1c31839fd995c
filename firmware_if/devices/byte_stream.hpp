#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace fathom::io {

// Bytes of a device in the order in which they came: a serial line, datagrams, a file. One thread reads. A
// stream that is not there yet or goes away is opened by read() itself, at most once a second.
class ByteStream {
 public:
  virtual ~ByteStream() = default;
  // Waits at most `timeout_ms` for bytes, then copies those that are there and returns how many; 0: none.
  [[nodiscard]] virtual std::size_t read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept = 0;
  [[nodiscard]] virtual bool isOpen() const noexcept = 0;
  // Why it is not; "" while it is.
  [[nodiscard]] virtual std::string_view reason() const noexcept { return {}; }
  // How often it has gone away.
  [[nodiscard]] virtual std::uint64_t disconnects() const noexcept = 0;
};

}  // namespace fathom::io

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace fathom::io {

// Bytes of a device in the order in which they came: a serial line, datagrams, a file. One thread reads. A
// stream that goes away is opened again by read() itself, at most once a second.
class ByteStream {
 public:
  virtual ~ByteStream() = default;
  // Waits at most `timeout_ms` for bytes, then copies those that are there and returns how many; 0: none.
  [[nodiscard]] virtual std::size_t read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept = 0;
  [[nodiscard]] virtual bool isOpen() const noexcept = 0;
  // How often it has gone away.
  [[nodiscard]] virtual std::uint64_t disconnects() const noexcept = 0;
};

}  // namespace fathom::io

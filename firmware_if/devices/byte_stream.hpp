#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "realtime/base/files/descriptor.hpp"

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

// The bytes of a capture, as fast as they are read. Closed at its end.
class FileStream final : public ByteStream {
 public:
  // Throws InputError when there is no such file or it cannot be read.
  explicit FileStream(const std::string& path);

  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept override;
  [[nodiscard]] bool isOpen() const noexcept override { return file_.open(); }
  [[nodiscard]] std::uint64_t disconnects() const noexcept override { return file_.open() ? 0 : 1; }

 private:
  Descriptor file_;
};

}  // namespace fathom::io

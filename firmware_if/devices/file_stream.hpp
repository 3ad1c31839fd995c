#pragma once

#include <cstdint>
#include <string>

#include "firmware_if/devices/byte_stream.hpp"

namespace fathom::io {

// The bytes of a capture, as fast as they are read. Closed at its end.
class FileStream final : public ByteStream {
 public:
  // Throws InputError when there is no such file or it cannot be read.
  explicit FileStream(const std::string& path);
  ~FileStream() override;
  FileStream(const FileStream&) = delete;
  FileStream& operator=(const FileStream&) = delete;

  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept override;
  [[nodiscard]] bool isOpen() const noexcept override { return fd_ >= 0; }
  [[nodiscard]] std::uint64_t disconnects() const noexcept override { return fd_ < 0 ? 1 : 0; }

 private:
  int fd_ = -1;
};

}  // namespace fathom::io

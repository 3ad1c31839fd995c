#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>

namespace fathom::io {

// A file (or pipe) of captured bytes, read front to back in pieces. A folder, an absent or an empty file is
// an InputError at construction or at the first read.
class ByteFile {
 public:
  explicit ByteFile(std::filesystem::path path);

  // Fills up to `buffer.size()` bytes and returns what was read; 0 at the end. Throws InputError on a read
  // error, or when the very first read finds the file empty.
  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer);

 private:
  struct Close {
    void operator()(std::FILE* file) const noexcept { std::fclose(file); }
  };
  std::filesystem::path path_;
  std::unique_ptr<std::FILE, Close> file_;
  bool anything_read_ = false;
};

}  // namespace fathom::io

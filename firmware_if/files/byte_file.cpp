#include "firmware_if/files/byte_file.hpp"

#include <cerrno>
#include <cstring>
#include <string>
#include <system_error>

#include "realtime/kernel/input_error.hpp"

namespace fathom::io {

ByteFile::ByteFile(std::filesystem::path path) : path_(std::move(path)) {
  std::error_code error;
  if (std::filesystem::is_directory(path_, error)) {
    throw InputError(path_.string(), "", "is a folder; name a file in it");
  }
  file_.reset(std::fopen(path_.c_str(), "rb"));
  if (!file_) {
    throw InputError(
        path_.string(), "",
        std::string("cannot be opened (") + std::strerror(errno) + "); check the path and permissions");
  }
}

std::size_t ByteFile::read(std::span<std::uint8_t> buffer) {
  const std::size_t got = std::fread(buffer.data(), 1, buffer.size(), file_.get());
  if (got < buffer.size() && std::ferror(file_.get()) != 0) {
    throw InputError(path_.string(), "",
                     std::string("cannot be read (") + std::strerror(errno) + "); check the device or disk");
  }
  if (got == 0 && !anything_read_)
    throw InputError(path_.string(), "", "is empty; give a capture with data in it");
  anything_read_ = true;
  return got;
}

}  // namespace fathom::io

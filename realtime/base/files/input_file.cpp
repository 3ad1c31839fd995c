#include "realtime/base/files/input_file.hpp"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <exception>
#include <fstream>
#include <string>
#include <system_error>

#include "realtime/base/input_error.hpp"

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

std::vector<std::uint8_t> readFileBytes(const std::filesystem::path& path, std::size_t max_bytes,
                                        const char* what) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error))
    throw InputError(path, "", std::string("is absent or no file; give ") + what);
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = in ? static_cast<std::streamoff>(in.tellg()) : -1;
  if (size < 0) throw InputError(path, "", "cannot be read; check its permissions");
  if (size == 0) throw InputError(path, "", std::string("is empty; give ") + what);
  if (static_cast<std::uint64_t>(size) > max_bytes)
    throw InputError(path, "",
                     "has " + std::to_string(size) + " bytes, more than the " + std::to_string(max_bytes) +
                         " that " + what + " may have");
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  in.seekg(0);
  if (!in.read(reinterpret_cast<char*>(bytes.data()), size))
    throw InputError(path, "", "cannot be read to its end; check the disk");
  return bytes;
}

}  // namespace fathom::io

namespace fathom {

NumberFile::NumberFile(const std::filesystem::path& path, const std::string& what) : path_(path) {
  std::ifstream in(path);
  std::error_code error;
  if (!in || std::filesystem::is_directory(path, error))
    throw InputError(path, "", "cannot be read; give " + what);
  std::string token;
  while (in >> token) {
    std::size_t used = 0;
    double value = 0.0;
    try {
      value = std::stod(token, &used);
    } catch (const std::exception&) {
      used = 0;
    }
    if (used != token.size() || !std::isfinite(value))
      throw InputError(path, "number " + std::to_string(numbers_.size() + 1),
                       "'" + token.substr(0, 40) + "' is not a number");
    numbers_.push_back(value);
  }
}

void NumberFile::fail(const std::string& fix) const {
  throw InputError(path_, "number " + std::to_string(index_), fix);
}

}  // namespace fathom

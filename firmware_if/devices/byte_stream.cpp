#include "firmware_if/devices/byte_stream.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>

#include "realtime/base/input_error.hpp"

namespace fathom::io {

FileStream::FileStream(const std::string& path) : file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (!file_.open()) throw InputError(path, "", std::string("cannot be read (") + std::strerror(errno) + ")");
  struct stat what = {};
  if (::fstat(file_.get(), &what) != 0 || !S_ISREG(what.st_mode))
    throw InputError(path, "", "is no file of bytes");
}

std::size_t FileStream::read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept {
  if (!file_.open()) {
    ::poll(nullptr, 0, timeout_ms);
    return 0;
  }
  const ssize_t n = ::read(file_.get(), buffer.data(), buffer.size());
  if (n > 0) return static_cast<std::size_t>(n);
  file_.reset();
  return 0;
}

}  // namespace fathom::io

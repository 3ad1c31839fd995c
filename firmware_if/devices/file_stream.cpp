#include "firmware_if/devices/file_stream.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "realtime/kernel/input_error.hpp"

namespace fathom::io {

FileStream::FileStream(const std::string& path) : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (fd_ < 0) throw InputError(path, "", std::string("cannot be read (") + std::strerror(errno) + ")");
  struct stat what = {};
  if (::fstat(fd_, &what) != 0 || !S_ISREG(what.st_mode)) {
    ::close(fd_);
    throw InputError(path, "", "is no file of bytes");
  }
}

FileStream::~FileStream() {
  if (fd_ >= 0) ::close(fd_);
}

std::size_t FileStream::read(std::span<std::uint8_t> buffer, int timeout_ms) noexcept {
  if (fd_ < 0) {
    ::poll(nullptr, 0, timeout_ms);
    return 0;
  }
  const ssize_t n = ::read(fd_, buffer.data(), buffer.size());
  if (n > 0) return static_cast<std::size_t>(n);
  ::close(fd_);
  fd_ = -1;
  return 0;
}

}  // namespace fathom::io

#include "firmware_if/recorder/image_writer.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "firmware_if/recorder/raw_tiff.hpp"

namespace fathom::io {
namespace {

constexpr char kHalf[] = ".tmp";

bool writeAll(int fd, const void* data, std::size_t size) {
  const auto* from = static_cast<const std::uint8_t*>(data);
  while (size > 0) {
    const ssize_t n = ::write(fd, from, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    from += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}

bool writePixels(int fd, const ImageView& image) {
  const std::size_t row_bytes = rowBytes(image);
  if (image.stride == row_bytes)
    return writeAll(fd, image.data, row_bytes * static_cast<std::size_t>(image.height));
  const auto* row = static_cast<const std::uint8_t*>(image.data);
  for (int y = 0; y < image.height; ++y, row += image.stride)
    if (!writeAll(fd, row, row_bytes)) return false;
  return true;
}

}  // namespace

ImageWriter::~ImageWriter() {
  discard();
  if (folder_ >= 0) ::close(folder_);
}

bool ImageWriter::refused(int error) noexcept {
  error_ = error;
  return false;
}

bool ImageWriter::write(const std::string& name, const ImageView& image) noexcept {
  if (folder_ < 0) folder_ = ::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder_ < 0) return refused(errno);
  if (::faccessat(folder_, name.c_str(), F_OK, 0) == 0) return refused(EEXIST);
  const std::string half = name + kHalf;
  Pending file;
  file.fd = ::openat(folder_, half.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file.fd < 0) return refused(errno);
  file.name = name;
  file.bytes = tiffBytes(image);
  // Not every file system can take room beforehand; then the writing finds out.
  const int taken = ::fallocate(file.fd, 0, 0, static_cast<off_t>(file.bytes));
  const bool room = taken == 0 || errno == EOPNOTSUPP || errno == ENOSYS;
  const TiffHead head = tiffHead(image);
  if (!room || !writeAll(file.fd, head.data(), head.size()) || !writePixels(file.fd, image)) {
    const int error = errno;
    ::close(file.fd);
    ::unlinkat(folder_, half.c_str(), 0);
    return refused(error);
  }
  ::sync_file_range(file.fd, 0, 0, SYNC_FILE_RANGE_WRITE);
  pending_.push_back(std::move(file));
  return true;
}

bool ImageWriter::commit() noexcept {
  if (pending_.empty()) return true;
  bool good = true;
  for (const Pending& file : pending_) good = good && ::fdatasync(file.fd) == 0;
  for (const Pending& file : pending_)
    good = good && ::renameat(folder_, (file.name + kHalf).c_str(), folder_, file.name.c_str()) == 0;
  good = good && ::fsync(folder_) == 0;
  if (!good) {
    const int error = errno;
    discard();
    return refused(error);
  }
  for (const Pending& file : pending_) {
    bytes_ += file.bytes;
    ::posix_fadvise(file.fd, 0, 0, POSIX_FADV_DONTNEED);
    ::close(file.fd);
  }
  pending_.clear();
  return true;
}

void ImageWriter::discard() noexcept {
  for (const Pending& file : pending_) {
    ::close(file.fd);
    ::unlinkat(folder_, (file.name + kHalf).c_str(), 0);
    ::unlinkat(folder_, file.name.c_str(), 0);
  }
  pending_.clear();
}

}  // namespace fathom::io

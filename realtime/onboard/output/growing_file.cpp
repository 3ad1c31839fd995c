#include "realtime/onboard/output/growing_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace fathom::onboard {

GrowingFile::GrowingFile(std::filesystem::path path, std::uint64_t room)
    : path_(std::move(path)),
      room_(room),
      // A page that was never written is not there yet.
      buffer_(kBufferBytes, std::uint8_t{1}),
      until_write_(kWriteBytes) {}

bool GrowingFile::refused() noexcept {
  error_ = errno;
  return false;
}

bool GrowingFile::makeOpen() noexcept {
  constexpr int kMode = 0644;
  if (file_.open()) return true;
  file_.reset(::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kMode));
  if (!file_.open()) return refused();
  takeRoom();
  return true;
}

bool GrowingFile::takeUp() noexcept {
  struct stat found {};
  if (!makeOpen() || ::fstat(file_.get(), &found) != 0) return refused();
  begun_ = true;
  written_ = static_cast<std::uint64_t>(found.st_size);
  return true;
}

void GrowingFile::takeRoom() noexcept {
  if (room_ > 0)
    (void)::fallocate(file_.get(), FALLOC_FL_KEEP_SIZE, static_cast<off_t>(written_),
                      static_cast<off_t>(room_));
}

void GrowingFile::open() {
  if (!takeUp()) throw std::runtime_error("cannot write " + path_.string() + ": " + std::strerror(error_));
}

void GrowingFile::add(std::span<const std::uint8_t> row) noexcept {
  begun_ = true;
  until_write_ -= std::min(until_write_, row.size());
  const auto fits = [&] { return row.size() <= buffer_.size() - waiting_; };
  // Before the first row is lost the disk is asked once more.
  if (until_write_ == 0 || (!fits() && lost_rows_ == 0)) (void)flush();
  if (!fits()) {
    ++lost_rows_;
    return;
  }
  std::copy(row.begin(), row.end(), buffer_.begin() + static_cast<std::ptrdiff_t>(waiting_));
  waiting_ += row.size();
}

bool GrowingFile::flush() noexcept {
  until_write_ = kWriteBytes;
  if (!begun_) return true;
  if (!makeOpen()) return false;
  const std::size_t done = writeAt(file_.get(), {buffer_.data(), waiting_}, written_);
  error_ = done < waiting_ ? errno : 0;
  std::copy(buffer_.begin() + static_cast<std::ptrdiff_t>(done),
            buffer_.begin() + static_cast<std::ptrdiff_t>(waiting_), buffer_.begin());
  written_ += done;
  waiting_ -= done;
  return error_ == 0 && lost_rows_ == 0;
}

std::string GrowingFile::failure() const {
  if (error_ == 0 && lost_rows_ == 0) return "";
  std::string what = path_.filename().string() + ":";
  if (lost_rows_ > 0) what += " " + std::to_string(lost_rows_) + " rows are lost";
  if (error_ != 0) what += std::string(lost_rows_ > 0 ? ", " : " ") + std::strerror(error_);
  return what;
}

bool GrowingFile::cutBack(bool begun, std::uint64_t bytes, std::uint64_t lost_rows) noexcept {
  if (begun && !begun_ && !takeUp()) return false;
  if (bytes > size() || (!begun && bytes > 0)) return false;
  if (!begun) {
    file_.reset();
    if (::unlink(path_.c_str()) != 0 && errno != ENOENT) return refused();
  } else if (file_.open() && bytes <= written_) {
    if (::ftruncate(file_.get(), static_cast<off_t>(bytes)) != 0) return refused();
  }
  waiting_ = bytes > written_ ? static_cast<std::size_t>(bytes - written_) : 0;
  written_ = std::min(written_, bytes);
  until_write_ = kWriteBytes;
  begun_ = begun;
  lost_rows_ = lost_rows;
  error_ = 0;
  if (file_.open()) takeRoom();
  return true;
}

std::vector<std::uint8_t> GrowingFile::read() {
  std::vector<std::uint8_t> all(written_);
  errno = 0;
  if (!readAt(file_.get(), all, 0)) {
    error_ = errno == 0 ? EIO : errno;  // or it is shorter than it was
    all.clear();
    return all;
  }
  all.insert(all.end(), buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(waiting_));
  return all;
}

bool GrowingFile::finish() noexcept {
  if (!begun_) return true;
  if (!flush()) return false;
  // Also gives back the room that was taken and not needed.
  if (::ftruncate(file_.get(), static_cast<off_t>(written_)) != 0) return refused();
  if (::fsync(file_.get()) != 0) return refused();
  return true;
}

}  // namespace fathom::onboard

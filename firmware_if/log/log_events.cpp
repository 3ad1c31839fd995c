#include "firmware_if/log/log_events.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::uint32_t kSyncWord = 0xEDA1DA01;
constexpr std::size_t kHeaderBytes = 28;
// Grows with what is unread, so that a log full of false lengths is not moved about in small steps.
constexpr std::size_t kLeastReadAhead = std::size_t{1} << 16, kMostReadAhead = std::size_t{1} << 20;
// Of a log that grows: what claims to be longer and is not whole has a wrong length. No recorder writes more.
constexpr std::size_t kMostUnfinished = std::size_t{4} << 20;

std::uint32_t bigEndian32(const std::uint8_t* p) {
  return std::uint32_t{p[0]} << 24 | std::uint32_t{p[1]} << 16 | std::uint32_t{p[2]} << 8 |
         std::uint32_t{p[3]};
}

std::int64_t bigEndian64(const std::uint8_t* p) {
  return static_cast<std::int64_t>(std::uint64_t{bigEndian32(p)} << 32 | bigEndian32(p + 4));
}

void putBigEndian(std::vector<std::uint8_t>& out, std::uint64_t value, int bytes) {
  for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8)
    out.push_back(static_cast<std::uint8_t>(value >> shift));
}

}  // namespace

std::size_t logEventBytes(std::string_view channel, std::span<const std::uint8_t> data) {
  return kHeaderBytes + channel.size() + data.size();
}

void appendLogEvent(std::vector<std::uint8_t>& out, std::int64_t number, std::int64_t timestamp_us,
                    std::string_view channel, std::span<const std::uint8_t> data) {
  if (channel.empty() || channel.size() > kMaxChannelBytes || data.size() > kMaxEventDataBytes)
    throw std::invalid_argument("an event of channel '" + std::string(channel) + "' and " +
                                std::to_string(data.size()) + " bytes does not fit an LCM log");
  putBigEndian(out, kSyncWord, 4);
  putBigEndian(out, static_cast<std::uint64_t>(number), 8);
  putBigEndian(out, static_cast<std::uint64_t>(timestamp_us), 8);
  putBigEndian(out, channel.size(), 4);
  putBigEndian(out, data.size(), 4);
  out.insert(out.end(), channel.begin(), channel.end());
  out.insert(out.end(), data.begin(), data.end());
}

LogEventReader::LogEventReader(const std::filesystem::path& path, std::uint64_t from, Log log)
    : path_(path), from_(from), grows_(log == Log::kGrows) {
  fd_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat status = {};
  if (fd_ < 0 || ::fstat(fd_, &status) != 0 || !S_ISREG(status.st_mode)) {
    if (fd_ >= 0) ::close(fd_);
    throw InputError(path, "", "is absent or cannot be read; give an LCM event log");
  }
  if (status.st_size == 0) {
    ::close(fd_);
    throw InputError(path, "", "is empty; nothing was recorded");
  }
  rewind();
}

LogEventReader::~LogEventReader() {
  ::close(fd_);
}

void LogEventReader::rewind() {
  damaged_ = end_of_last_event_ = 0;
  read_again_at_ = UINT64_MAX;
  beginAt(from_);
}

void LogEventReader::beginAt(std::uint64_t offset) {
  ::lseek(fd_, static_cast<off_t>(offset), SEEK_SET);
  begin_ = end_ = 0;
  buffer_file_offset_ = offset;
  at_end_of_file_ = false;
  read_error_ = 0;
}

std::string LogEventReader::failure() const {
  if (!readFailed()) return "";
  return "cannot be read beyond byte " + std::to_string(buffer_file_offset_ + end_) + " (" +
         std::strerror(read_error_) + ")";
}

void LogEventReader::throwIfReadFailed() const {
  if (readFailed()) throw InputError(path_, "", failure() + "; check the disk");
}

// Makes at least `bytes` unread bytes present; false when the file ends before, or cannot be read.
bool LogEventReader::fill(std::size_t bytes) {
  if (end_ - begin_ >= bytes) return true;
  if (at_end_of_file_ || readFailed()) return false;
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    buffer_file_offset_ += begin_;
    end_ -= begin_;
    begin_ = 0;
  }
  while (end_ < bytes && !at_end_of_file_ && !readFailed()) {
    // Grown with what the file gives, never to what a damaged length claims.
    const std::size_t ahead = std::clamp(end_, kLeastReadAhead, kMostReadAhead);
    if (buffer_.size() < end_ + ahead) buffer_.resize(end_ + ahead);
    const ssize_t n = ::read(fd_, buffer_.data() + end_, buffer_.size() - end_);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0)
      read_error_ = errno;
    else if (n == 0)
      at_end_of_file_ = true;
    else
      end_ += static_cast<std::size_t>(n);
  }
  return end_ >= bytes;
}

// Whether an event may begin at buffer_[offset]; a header cut by the end of the buffer may not.
bool LogEventReader::believableHeader(std::size_t offset) const {
  if (offset + kHeaderBytes > end_) return false;
  const std::uint8_t* p = buffer_.data() + offset;
  const std::uint32_t channel_bytes = bigEndian32(p + 20), data_bytes = bigEndian32(p + 24);
  return bigEndian32(p) == kSyncWord && channel_bytes >= 1 && channel_bytes <= kMaxChannelBytes &&
         data_bytes <= kMaxEventDataBytes;
}

// The first believable header in [from, to), or `to`.
std::size_t LogEventReader::findHeader(std::size_t from, std::size_t to) const {
  for (std::size_t at = from; at < to; ++at) {
    const void* hit = std::memchr(buffer_.data() + at, kSyncWord >> 24, to - at);
    if (hit == nullptr) return to;
    at = static_cast<std::size_t>(static_cast<const std::uint8_t*>(hit) - buffer_.data());
    if (believableHeader(at)) return at;
  }
  return to;
}

bool LogEventReader::next(LogEvent& event) {
  if (!grows_) return find(event);
  const std::uint64_t damaged = damaged_, behind_last = std::max(from_, end_of_last_event_);
  if (at_end_of_file_ || readFailed()) beginAt(behind_last);
  bool found = find(event);
  if (found && damaged_ != damaged && mayReadAgain(behind_last)) {
    end_of_last_event_ = behind_last > from_ ? behind_last : 0;
    damaged_ = damaged;
    beginAt(behind_last);
    found = find(event);
  }
  if (!found) damaged_ = damaged;
  return found;
}

bool LogEventReader::readLastAgain() {
  if (!grows_ || !mayReadAgain(begin_of_last_event_)) return false;
  beginAt(begin_of_last_event_);
  end_of_last_event_ = begin_of_last_event_ > from_ ? begin_of_last_event_ : 0;
  return true;
}

bool LogEventReader::mayReadAgain(std::uint64_t offset) {
  if (read_again_at_ == offset) return false;
  read_again_at_ = offset;
  return true;
}

bool LogEventReader::find(LogEvent& event) {
  // Up to the first event, a reader that began inside the file only looks for one.
  bool in_damage = !grows_ && from_ > 0 && end_of_last_event_ == 0;
  const auto skipTo = [&](std::size_t offset) {
    if (!in_damage) ++damaged_;
    in_damage = true;
    begin_ = offset;
  };
  for (;;) {
    if (!fill(kHeaderBytes)) {
      if (end_ > begin_ && !readFailed()) skipTo(end_);
      return false;
    }
    if (!believableHeader(begin_)) {
      // The last bytes of the buffer may hold the beginning of a header: keep them.
      skipTo(findHeader(begin_ + 1, end_ - kHeaderBytes + 1));
      continue;
    }
    const std::size_t channel_bytes = bigEndian32(buffer_.data() + begin_ + 20);
    const std::size_t data_bytes = bigEndian32(buffer_.data() + begin_ + 24);
    const std::size_t event_bytes = kHeaderBytes + channel_bytes + data_bytes;
    const bool whole = fill(event_bytes);
    if (!whole && (readFailed() || (grows_ && event_bytes <= kMostUnfinished))) return false;
    // An event is trusted when another begins behind it or the file ends there. Otherwise either its lengths
    // are wrong, and then other events lie inside the bytes that it claims, or only what follows is damaged.
    const bool followed =
        whole && (fill(event_bytes + kHeaderBytes) ? believableHeader(begin_ + event_bytes)
                                                   : grows_ || end_ - begin_ == event_bytes);
    if (!followed) {
      const std::size_t claimed_end = std::min(end_, begin_ + event_bytes);
      const std::size_t inside = findHeader(begin_ + 1, claimed_end);
      if (inside != claimed_end || !whole) {
        skipTo(inside);
        continue;
      }
    }
    const std::uint8_t* p = buffer_.data() + begin_;
    event.number = bigEndian64(p + 4);
    event.timestamp_us = bigEndian64(p + 12);
    event.channel = {reinterpret_cast<const char*>(p + kHeaderBytes), channel_bytes};
    event.data = {p + kHeaderBytes + channel_bytes, data_bytes};
    begin_of_last_event_ = buffer_file_offset_ + begin_;
    begin_ += event_bytes;
    end_of_last_event_ = buffer_file_offset_ + begin_;
    return true;
  }
}

LogEnd findLogEnd(const std::filesystem::path& path) {
  constexpr std::uint64_t kFirstPiece = std::uint64_t{1} << 18;
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(path, error);
  if (error) throw InputError(path, "", "cannot be read (" + error.message() + ")");
  for (std::uint64_t piece = kFirstPiece;; piece *= 4) {
    const std::uint64_t from = piece < size ? size - piece : 0;
    LogEventReader events(path, from);
    LogEvent event;
    LogEnd end;
    while (events.next(event)) end = {events.endOfLastEvent(), event.number + 1, ""};
    end.failure = events.failure();
    if (end.offset > 0 || from == 0 || !end.failure.empty()) return end;
  }
}

LogEventWriter::LogEventWriter(const std::filesystem::path& path) : path_(path.string()) {
  std::error_code error;
  if (std::filesystem::exists(path, error) && std::filesystem::file_size(path, error) > 0) {
    LogEventReader existing(path);
    LogEvent event;
    while (existing.next(event)) ++next_number_;
    existing.throwIfReadFailed();
    size_ = existing.endOfLastEvent();
    if (size_ == 0) throw InputError(path, "", "exists and is no LCM event log; move it away");
  }
  fd_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644);
  if (fd_ < 0 || ::ftruncate(fd_, static_cast<off_t>(size_)) != 0 ||
      ::lseek(fd_, static_cast<off_t>(size_), SEEK_SET) < 0) {
    if (fd_ >= 0) ::close(fd_);
    throw InputError(path, "",
                     std::string("cannot be written (") + std::strerror(errno) + "); check the folder");
  }
}

LogEventWriter::~LogEventWriter() {
  ::close(fd_);
}

void LogEventWriter::write(std::int64_t timestamp_us, std::string_view channel,
                           std::span<const std::uint8_t> data) {
  frame_.clear();
  appendLogEvent(frame_, next_number_, timestamp_us, channel, data);
  std::size_t done = 0;
  while (done < frame_.size()) {
    const ssize_t n = ::write(fd_, frame_.data() + done, frame_.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      const std::string reason = std::strerror(errno);
      // Takes back a part of the event, so that what follows begins on a whole one.
      if (::ftruncate(fd_, static_cast<off_t>(size_)) == 0) ::lseek(fd_, static_cast<off_t>(size_), SEEK_SET);
      throw std::runtime_error("cannot write " + path_ + ": " + reason);
    }
    done += static_cast<std::size_t>(n);
  }
  size_ += frame_.size();
  ++next_number_;
}

void LogEventWriter::sync() {
  if (::fdatasync(fd_) != 0) throw std::runtime_error("cannot write " + path_ + ": " + std::strerror(errno));
}

}  // namespace fathom::io

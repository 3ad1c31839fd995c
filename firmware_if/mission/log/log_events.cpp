#include "firmware_if/mission/log/log_events.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::uint32_t kSyncWord = 0xEDA1DA01;
constexpr std::size_t kEventHeaderBytes = 28;
// Grows with what is unread, so that a log full of false lengths is not moved about in small steps.
constexpr std::size_t kLeastReadAhead = std::size_t{1} << 16, kMostReadAhead = std::size_t{1} << 20;
// Of a log that grows: what claims to be longer and is not whole has a wrong length. No recorder writes more.
constexpr std::size_t kMostUnfinished = std::size_t{4} << 20;

}  // namespace

std::size_t logEventBytes(std::string_view channel, std::span<const std::uint8_t> data) {
  return kEventHeaderBytes + channel.size() + data.size();
}

void appendLogEvent(std::vector<std::uint8_t>& out, std::int64_t number, std::int64_t timestamp_us,
                    std::string_view channel, std::span<const std::uint8_t> data) {
  if (channel.empty() || channel.size() > kMaxChannelBytes || data.size() > kMaxEventDataBytes)
    throw std::invalid_argument("an event of channel '" + std::string(channel) + "' and " +
                                std::to_string(data.size()) + " bytes does not fit an LCM log");
  std::array<std::uint8_t, kEventHeaderBytes> header;
  const std::span bytes(header);
  writeBigEndian(bytes.first(4), kSyncWord);
  writeBigEndian(bytes.subspan(4, 8), static_cast<std::uint64_t>(number));
  writeBigEndian(bytes.subspan(12, 8), static_cast<std::uint64_t>(timestamp_us));
  writeBigEndian(bytes.subspan(20, 4), channel.size());
  writeBigEndian(bytes.subspan(24, 4), data.size());
  out.insert(out.end(), header.begin(), header.end());
  out.insert(out.end(), channel.begin(), channel.end());
  out.insert(out.end(), data.begin(), data.end());
}

LogEventReader::LogEventReader(const std::filesystem::path& path, std::uint64_t from, Log log)
    : path_(path), from_(from), grows_(log == Log::kGrows) {
  file_.reset(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status = {};
  if (!file_.open() || ::fstat(file_.get(), &status) != 0 || !S_ISREG(status.st_mode))
    throw InputError(path, "", "is absent or cannot be read; give an LCM event log");
  if (status.st_size == 0) throw InputError(path, "", "is empty; nothing was recorded");
  rewind();
}

void LogEventReader::rewind() {
  damaged_ = end_of_last_event_ = 0;
  read_again_at_ = UINT64_MAX;
  beginAt(from_);
}

void LogEventReader::beginAt(std::uint64_t offset) {
  ::lseek(file_.get(), static_cast<off_t>(offset), SEEK_SET);
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
    const ssize_t n = ::read(file_.get(), buffer_.data() + end_, buffer_.size() - end_);
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
bool LogEventReader::possibleHeader(std::size_t offset) const {
  if (offset + kEventHeaderBytes > end_) return false;
  const auto header = std::span<const std::uint8_t>(buffer_).subspan(offset, kEventHeaderBytes);
  const auto channel_bytes = bigEndianAt<std::uint32_t>(header, 20);
  const auto data_bytes = bigEndianAt<std::uint32_t>(header, 24);
  return bigEndianAt<std::uint32_t>(header, 0) == kSyncWord && channel_bytes >= 1 &&
         channel_bytes <= kMaxChannelBytes && data_bytes <= kMaxEventDataBytes;
}

// The first possible header in [from, to), or `to`.
std::size_t LogEventReader::findHeader(std::size_t from, std::size_t to) const {
  for (std::size_t at = from; at < to; ++at) {
    const void* hit = std::memchr(buffer_.data() + at, kSyncWord >> 24, to - at);
    if (hit == nullptr) return to;
    at = static_cast<std::size_t>(static_cast<const std::uint8_t*>(hit) - buffer_.data());
    if (possibleHeader(at)) return at;
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
    if (!fill(kEventHeaderBytes)) {
      if (end_ > begin_ && !readFailed()) skipTo(end_);
      return false;
    }
    if (!possibleHeader(begin_)) {
      // The last bytes of the buffer may hold the beginning of a header: keep them.
      skipTo(findHeader(begin_ + 1, end_ - kEventHeaderBytes + 1));
      continue;
    }
    const std::size_t channel_bytes = bigEndianAt<std::uint32_t>(buffer_, begin_ + 20);
    const std::size_t data_bytes = bigEndianAt<std::uint32_t>(buffer_, begin_ + 24);
    const std::size_t event_bytes = kEventHeaderBytes + channel_bytes + data_bytes;
    const bool whole = fill(event_bytes);
    if (!whole && (readFailed() || (grows_ && event_bytes <= kMostUnfinished))) return false;
    // An event is valid when another begins behind it or the file ends there. Otherwise either its lengths
    // are wrong, and then other events are inside the bytes that it claims, or only what follows is damaged.
    const bool followed =
        whole && (fill(event_bytes + kEventHeaderBytes) ? possibleHeader(begin_ + event_bytes)
                                                        : grows_ || end_ - begin_ == event_bytes);
    if (!followed) {
      const std::size_t claimed_end = std::min(end_, begin_ + event_bytes);
      const std::size_t inside = findHeader(begin_ + 1, claimed_end);
      if (inside != claimed_end || !whole) {
        skipTo(inside);
        continue;
      }
    }
    const std::uint8_t* body = buffer_.data() + begin_ + kEventHeaderBytes;
    event.number = bigEndianAt<std::int64_t>(buffer_, begin_ + 4);
    event.timestamp_us = bigEndianAt<std::int64_t>(buffer_, begin_ + 12);
    event.channel = {reinterpret_cast<const char*>(body), channel_bytes};
    event.data = {body + channel_bytes, data_bytes};
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
  file_.reset(::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644));
  if (!file_.open() || ::ftruncate(file_.get(), static_cast<off_t>(size_)) != 0)
    throw InputError(path, "",
                     std::string("cannot be written (") + std::strerror(errno) + "); check the folder");
}

void LogEventWriter::write(std::int64_t timestamp_us, std::string_view channel,
                           std::span<const std::uint8_t> data) {
  frame_.clear();
  appendLogEvent(frame_, next_number_, timestamp_us, channel, data);
  if (writeAt(file_.get(), frame_, size_) < frame_.size()) {
    const std::string reason = std::strerror(errno);
    // Takes back a part of the event, so that what follows begins on a whole one.
    static_cast<void>(::ftruncate(file_.get(), static_cast<off_t>(size_)));
    throw std::runtime_error("cannot write " + path_ + ": " + reason);
  }
  size_ += frame_.size();
  ++next_number_;
}

void LogEventWriter::sync() {
  if (::fdatasync(file_.get()) != 0)
    throw std::runtime_error("cannot write " + path_ + ": " + std::strerror(errno));
}

}  // namespace fathom::io

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "realtime/base/files/descriptor.hpp"

namespace fathom::io {

// The framing of an LCM event log, as liblcm writes it: for each event the sync word 0xEDA1DA01, event number
// (8 bytes), time stamp in microseconds (8), length of the channel name (4), length of the data (4), all big
// endian; then name and data. liblcm's own reader does not check these lengths, which may be damaged in a log
// from a vehicle that lost power; so reading is done here.
struct LogEvent {
  std::int64_t number = 0;
  std::int64_t timestamp_us = 0;       // arrival, since the Unix epoch, UTC
  std::string_view channel;            // valid until the next call of next()
  std::span<const std::uint8_t> data;  // valid until the next call of next()
};

constexpr std::size_t kMaxChannelBytes = 63;  // LCM_MAX_CHANNEL_NAME_LENGTH
constexpr std::size_t kMaxEventDataBytes = std::size_t{1} << 24;

// Appends the bytes of an event to `out`. Throws std::invalid_argument for a channel or data that do not fit.
void appendLogEvent(std::vector<std::uint8_t>& out, std::int64_t number, std::int64_t timestamp_us,
                    std::string_view channel, std::span<const std::uint8_t> data);
[[nodiscard]] std::size_t logEventBytes(std::string_view channel, std::span<const std::uint8_t> data);

// Walks the events of a log of any size with a bounded buffer. Damage is skipped up to the next sync word
// that begins a possible event; each stretch skipped counts once, a cut last event too. A disk that refuses
// to be read is neither damage nor the end: next() gives false, and readFailed() says so.
//
// A log that grows (kGrows) is being written: a last event that is not whole is no damage but not there yet,
// and next() may be called again after it gave false, and continues when more has come. Bytes that look
// damaged are first read from the file once more, because they may not have been written when they were read.
// An event with a wrong length delays those behind it until the file has 4 MiB more.
class LogEventReader {
 public:
  enum class Log : std::uint8_t { kIsWhole, kGrows };
  // Throws InputError for an absent, unreadable or empty file.
  explicit LogEventReader(const std::filesystem::path& path) : LogEventReader(path, 0) {}
  // Begins at the first event behind byte `from`, which need not be where one begins; what is passed over to
  // find it is no damage; of a log that grows, an event begins there.
  LogEventReader(const std::filesystem::path& path, std::uint64_t from, Log log = Log::kIsWhole);

  [[nodiscard]] bool next(LogEvent& event);
  // Begins again where it began, with the counts at zero.
  void rewind();
  // Of a log that grows, when the event that next() gave makes no sense: next() gives it again, read from the
  // file once more. False when that was done for it already.
  [[nodiscard]] bool readLastAgain();
  [[nodiscard]] std::uint64_t damagedStretches() const { return damaged_; }
  // Offset in the file just behind the last event that was returned [bytes].
  [[nodiscard]] std::uint64_t endOfLastEvent() const { return end_of_last_event_; }

  // After next() gave false: the disk refused, more may follow. failure() says where and why ("cannot be read
  // beyond byte 4096 (Input/output error)"; "" when all is well), throwIfReadFailed() throws it as
  // InputError.
  [[nodiscard]] bool readFailed() const { return read_error_ != 0; }
  [[nodiscard]] std::string failure() const;
  void throwIfReadFailed() const;

 private:
  bool find(LogEvent& event);
  void beginAt(std::uint64_t offset);
  [[nodiscard]] bool mayReadAgain(std::uint64_t offset);
  bool fill(std::size_t bytes);
  [[nodiscard]] bool possibleHeader(std::size_t offset) const;
  [[nodiscard]] std::size_t findHeader(std::size_t from, std::size_t to) const;

  std::filesystem::path path_;
  Descriptor file_;
  std::uint64_t from_ = 0;
  bool grows_ = false;
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0, end_ = 0;       // unread bytes in buffer_
  std::uint64_t buffer_file_offset_ = 0;  // in the file, of buffer_[0]
  bool at_end_of_file_ = false;
  int read_error_ = 0;  // errno of a read that failed: it ends there
  std::uint64_t damaged_ = 0;
  std::uint64_t begin_of_last_event_ = 0, end_of_last_event_ = 0;
  std::uint64_t read_again_at_ = UINT64_MAX;
};

// End of a log, searched for backwards from the end of the file, so that five hours are not read.
struct LogEnd {
  std::uint64_t offset = 0;      // behind the last whole event; 0: there is none [bytes]
  std::int64_t next_number = 0;  // of the event to be written there
  std::string failure;           // where and why the disk could not be read, the end is unknown then; else ""
};
// Throws InputError for an absent, unreadable or empty file.
[[nodiscard]] LogEnd findLogEnd(const std::filesystem::path& path);

// Appends events, each with one write to the system: a program that dies leaves whole events, a machine that
// loses power a cut last one. An existing log is continued behind its last whole event.
class LogEventWriter {
 public:
  // Throws InputError for a path that cannot be written.
  explicit LogEventWriter(const std::filesystem::path& path);

  // Throws std::runtime_error when the disk refuses; the log then ends behind the event before.
  void write(std::int64_t timestamp_us, std::string_view channel, std::span<const std::uint8_t> data);
  // Waits until the disk holds every event written.
  void sync();

 private:
  std::string path_;
  Descriptor file_;
  std::int64_t next_number_ = 0;
  std::uint64_t size_ = 0;  // of the file, whole events [bytes]
  std::vector<std::uint8_t> frame_;
};

}  // namespace fathom::io

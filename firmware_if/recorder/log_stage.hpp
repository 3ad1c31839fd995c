#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/recorder/image_stage.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {

// Records of any length from exactly one producing thread to exactly one consuming thread, in memory taken
// and touched at construction; wait-free on both sides. Full: push refuses the record and counts it.
class ByteRing {
 public:
  // Rounded up to a power of two of at least 4 KiB.
  explicit ByteRing(std::size_t bytes) : memory_(powerOfTwo(bytes), 0) {}
  ByteRing(const ByteRing&) = delete;
  ByteRing& operator=(const ByteRing&) = delete;

  // Producer only: one record, the parts one behind the other, at most mostBytes() together.
  [[nodiscard]] bool push(std::initializer_list<std::span<const std::uint8_t>> parts) noexcept {
    std::size_t size = 0;
    for (const auto& part : parts) size += part.size();
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    const std::size_t used = tail - head_.load(std::memory_order_acquire);
    const std::size_t at = tail % memory_.size();
    const std::size_t whole = kSizeBytes + rounded(size);
    // A record is in one piece: too little room at the end of the memory is passed over.
    const std::size_t passed_over = at + whole > memory_.size() ? memory_.size() - at : 0;
    if (size > mostBytes() || used + passed_over + whole > memory_.size()) {
      refused_.store(refused_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
      return false;
    }
    if (passed_over > 0) putSize(at, kPassOver);
    std::size_t to = (at + passed_over) % memory_.size();
    putSize(to, size);
    to += kSizeBytes;
    for (const auto& part : parts) {
      if (!part.empty()) std::memcpy(memory_.data() + to, part.data(), part.size());
      to += part.size();
    }
    tail_.store(tail + passed_over + whole, std::memory_order_release);
    const std::size_t now_used = used + passed_over + whole;
    if (now_used > high_water_.load(std::memory_order_relaxed))
      high_water_.store(now_used, std::memory_order_relaxed);
    return true;
  }

  // Consumer only: the oldest record, until pop(); empty when there is none (records are never empty).
  [[nodiscard]] std::span<const std::uint8_t> front() noexcept {
    std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return {};
    std::size_t at = head % memory_.size();
    if (sizeAt(at) == kPassOver) {
      head += memory_.size() - at;
      head_.store(head, std::memory_order_release);
      at = 0;
    }
    return {memory_.data() + at + kSizeBytes, sizeAt(at)};
  }
  // Consumer only, after front() gave a record.
  void pop() noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    head_.store(head + kSizeBytes + rounded(sizeAt(head % memory_.size())), std::memory_order_release);
  }

  [[nodiscard]] std::size_t mostBytes() const noexcept { return memory_.size() / 4; }  // of one record
  [[nodiscard]] std::size_t capacity() const noexcept { return memory_.size(); }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t highWater() const noexcept { return high_water_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::size_t kSizeBytes = 8;
  static constexpr std::uint64_t kPassOver = UINT64_MAX;

  static std::size_t powerOfTwo(std::size_t bytes) {
    std::size_t size = 4096;
    while (size < bytes) size *= 2;
    return size;
  }
  static std::size_t rounded(std::size_t size) noexcept {
    return (size + kSizeBytes - 1) / kSizeBytes * kSizeBytes;
  }
  void putSize(std::size_t at, std::uint64_t size) noexcept {
    std::memcpy(memory_.data() + at, &size, kSizeBytes);
  }
  [[nodiscard]] std::uint64_t sizeAt(std::size_t at) const noexcept {
    std::uint64_t size;
    std::memcpy(&size, memory_.data() + at, kSizeBytes);
    return size;
  }

  std::vector<std::uint8_t> memory_;
  alignas(rt::kCacheLine) std::atomic<std::size_t> tail_{0};
  std::atomic<std::size_t> high_water_{0};
  std::atomic<std::uint64_t> refused_{0};
  alignas(rt::kCacheLine) std::atomic<std::size_t> head_{0};
};

// Raw bytes and encoded messages of one producer that wait for the log.
class RawLane {
 public:
  enum class Kind : std::uint8_t { kRaw, kMessage };
  struct Entry {
    Kind kind = Kind::kRaw;
    std::int64_t arrival_utc_ns = 0;
    std::string_view channel;
    std::span<const std::uint8_t> data;
  };

  explicit RawLane(std::size_t bytes) : ring_(bytes) {}

  // Producer only; wait-free.
  [[nodiscard]] bool offer(const Entry& entry) noexcept {
    const std::string_view channel = entry.channel.substr(0, kMaxChannelBytes);
    const Head head{entry.arrival_utc_ns, entry.kind, static_cast<std::uint8_t>(channel.size())};
    return ring_.push({{reinterpret_cast<const std::uint8_t*>(&head), sizeof head},
                       {reinterpret_cast<const std::uint8_t*>(channel.data()), channel.size()},
                       entry.data});
  }
  // Consumer only: the oldest, into the lane's memory until pop(); false when there is none.
  [[nodiscard]] bool front(Entry& entry) noexcept {
    const std::span<const std::uint8_t> record = ring_.front();
    if (record.empty()) return false;
    Head head;
    std::memcpy(&head, record.data(), sizeof head);
    entry.kind = head.kind;
    entry.arrival_utc_ns = head.arrival_utc_ns;
    entry.channel = {reinterpret_cast<const char*>(record.data()) + sizeof head, head.channel_bytes};
    entry.data = record.subspan(sizeof head + head.channel_bytes);
    return true;
  }
  void pop() noexcept { ring_.pop(); }

  [[nodiscard]] std::uint64_t refused() const noexcept { return ring_.refused(); }

 private:
  struct Head {
    std::int64_t arrival_utc_ns = 0;
    Kind kind = Kind::kRaw;
    std::uint8_t channel_bytes = 0;
  };
  ByteRing ring_;
};

struct InputLaneEntry {
  std::uint64_t number = 0;     // of all that were offered
  std::int64_t offered_ns = 0;  // monotonic
  OnboardInput input;
};

// Inputs that wait for the log. All are numbered when they are offered, also those that find no room, so that
// the recorder finds where some are missing.
class InputLane {
 public:
  using Entry = InputLaneEntry;
  static constexpr std::size_t kCapacity = 4096;  // half a minute of every sensor at its full rate

  // Producer only; wait-free.
  [[nodiscard]] bool offer(const OnboardInput& input) noexcept {
    offered_.number = number_.load(std::memory_order_relaxed);
    number_.store(offered_.number + 1, std::memory_order_relaxed);
    offered_.offered_ns = clock_.monotonicNs();
    offered_.input = input;
    return ring_.push(offered_);
  }

  // Consumer only: the oldest entry, or nullptr.
  [[nodiscard]] const Entry* front() noexcept {
    if (!held_) held_ = ring_.pop(front_);
    return held_ ? &front_ : nullptr;
  }
  // Consumer only, after front() gave one: how many were refused just before it; and on to the next.
  [[nodiscard]] std::uint64_t missingBeforeFront() const noexcept { return front_.number - next_; }
  void pop() noexcept {
    held_ = false;
    next_ = front_.number + 1;
  }
  // Number of the next that is to come: all before it were popped, or refused.
  [[nodiscard]] std::uint64_t next() const noexcept { return next_; }
  // After the producer has ended, when front() gives none: how many were refused behind the last one; and on
  // behind them.
  [[nodiscard]] std::uint64_t missingAtEnd() const noexcept {
    return number_.load(std::memory_order_relaxed) - next_;
  }
  void passOverEnd() noexcept { next_ = number_.load(std::memory_order_relaxed); }

  [[nodiscard]] std::uint64_t refused() const noexcept { return ring_.refused(); }
  [[nodiscard]] std::size_t highWater() const noexcept { return ring_.highWater(); }

 private:
  rt::RealClock clock_;
  rt::SpscRing<Entry, kCapacity> ring_;
  alignas(rt::kCacheLine) Entry offered_;  // the producer's
  std::atomic<std::uint64_t> number_{0};
  alignas(rt::kCacheLine) Entry front_;  // the consumer's
  std::uint64_t next_ = 0;
  bool held_ = false;
};

// sensors.lcmlog as an append-only journal. Events gather in memory of a fixed size, go to the system in
// pieces, and stay in memory until sync() has put them on the disk. Room is taken on the disk behind the end
// of the file (FALLOC_FL_KEEP_SIZE: the file's size stays that of its events, so that every reader of LCM
// logs reads it); close() gives unused room back.
//
// The next write() tries again what the disk refused; until then the file may end in a part of an event,
// which readers pass over. After a failed sync everything since the last good one is written again: the
// system may have dropped it. A file that cannot be read is never cut.
class JournalFile {
 public:
  // Takes the memory; no file yet.
  JournalFile();

  // Continues an existing log behind its last whole event; anything behind that is cut away. `room` is taken
  // beforehand as far as the disk has it, leaving `leave_free` [bytes]. False when the disk refuses, or the
  // end of the log cannot be read: then no event is cut, and it may be called again. Throws InputError for a
  // file that is no LCM log.
  [[nodiscard]] bool open(const std::filesystem::path& path, std::uint64_t room, std::uint64_t leave_free);
  [[nodiscard]] bool isOpen() const noexcept { return file_.open(); }

  // The rest only while it is open. The event takes at most spare() bytes with its framing.
  void append(std::int64_t timestamp_us, std::string_view channel, std::span<const std::uint8_t> data);
  // Hands what gathered to the system; false when it refuses.
  [[nodiscard]] bool write() noexcept;
  // Waits until the disk holds all that was written; false when it reports a failure.
  [[nodiscard]] bool sync() noexcept;
  // Gives back the room behind the end. Nothing is appended after.
  void close() noexcept;

  // Reason of the last open(), write() or sync() that was refused, in words.
  [[nodiscard]] const std::string& failure() const noexcept { return failure_; }
  // What the memory has left [bytes]: little when the disk has refused for long, or when sync() is due.
  [[nodiscard]] std::size_t spare() const noexcept;
  // The disk holds everything that was appended.
  [[nodiscard]] bool safe() const noexcept { return memory_.empty(); }
  // Some of it was written and waits for sync().
  [[nodiscard]] bool unsynced() const noexcept { return written_ > 0; }
  [[nodiscard]] std::uint64_t size() const noexcept { return synced_ + written_; }
  [[nodiscard]] std::uint64_t wholeAtStart() const noexcept { return whole_at_start_; }
  [[nodiscard]] std::uint64_t cutAtStart() const noexcept { return cut_at_start_; }

 private:
  [[nodiscard]] bool continueBehind(int fd, const std::filesystem::path& path);
  [[nodiscard]] bool refused(const char* what) noexcept;
  void dropFromCache() noexcept;
  void takeRoom(std::uint64_t room, std::uint64_t leave_free) noexcept;

  Descriptor file_;
  std::int64_t next_number_ = 0;
  std::uint64_t synced_ = 0;       // of the file on the disk for certain
  std::uint64_t cached_from_ = 0;  // the system's cache was emptied up to here
  std::uint64_t whole_at_start_ = 0, cut_at_start_ = 0;
  std::vector<std::uint8_t> memory_;  // what follows synced_
  std::size_t written_ = 0;           // of memory_, handed to the system
  std::string failure_;
};

// Moves inputs, decisions, raw bytes and messages from their lanes into the log, by arrival, each lane in its
// own order, and syncs the log to disk. While writes or syncs fail, inputs queue in the log's memory, then
// in the lanes; raw bytes and messages are dropped while the log is not open.
class LogStage {
 public:
  struct Counters {
    std::uint64_t inputs = 0, decisions = 0, raw_entries = 0, messages = 0;  // written
    std::uint64_t inputs_safe = 0;
    std::uint64_t inputs_passed = 0, decisions_passed = 0;  // safe, plus refused ones in a synced gap
    std::uint64_t syncs = 0, syncs_failed = 0;
    std::uint64_t raw_dropped = 0;  // disk nearly full (`with_raw` false), or the log not open
    std::uint64_t write_failures = 0;
    std::int64_t worst_sync_ns = 0, worst_unsafe_ns = 0;
  };

  // `log` may be open or not; `images` say what became of the exposures that inputs name.
  LogStage(const RecorderConfig& config, JournalFile& log, ImageStage& images);

  // One producer thread per lane.
  [[nodiscard]] InputLane& inputs() noexcept { return inputs_; }
  [[nodiscard]] InputLane& decisions() noexcept { return decisions_; }
  [[nodiscard]] RawLane* raw(std::size_t lane) noexcept {
    return lane < raw_.size() ? raw_[lane].get() : nullptr;
  }
  [[nodiscard]] std::uint64_t rawRefused() const noexcept;  // any thread

  // The rest: the recorder's thread only.
  // Moves what waits into the log's memory until an input names an exposure that is not written yet, the
  // memory is full, or `deadline` (monotonic [ns]) is past. `with_raw` false: drops raw bytes and messages.
  void drain(std::int64_t deadline, bool with_raw, const std::string& vehicle_name);
  // Writes the log's memory to the file, and syncs it when due; nothing while the log is not open.
  void handOver();
  // Logs as missing what was refused behind the last input and the last decision, and syncs all to the disk;
  // after the producers have ended and the lanes are empty. True when the disk has it.
  [[nodiscard]] bool end();

  [[nodiscard]] bool waiting();
  // The log is not open, or the disk refused its last write or sync.
  [[nodiscard]] bool refuses() const noexcept { return refuses_write_ || refuses_sync_ || !log_.isOpen(); }
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

 private:
  [[nodiscard]] bool logInput(InputLane& lane, const std::string& vehicle_name);
  [[nodiscard]] bool logRaw(RawLane& lane, const RawLane::Entry& entry, bool with_raw);
  void dropRaw(RawLane& lane);
  void logMissing(const InputLane& lane, std::uint64_t count, std::int64_t arrival_utc_ns);
  void logGap(const RecordingGap& gap);
  void append(std::int64_t arrival_utc_ns, const LogMessage& message, std::int64_t offered_ns);
  void syncIfDue();
  void sync();

  rt::RealClock clock_;
  RecorderConfig config_;
  JournalFile& log_;
  ImageStage& images_;
  InputLane inputs_, decisions_;
  std::vector<std::unique_ptr<RawLane>> raw_;

  Counters counters_;
  std::uint64_t raw_missing_logged_ = 0;
  std::int64_t newest_utc_ns_ = 0;  // arrival of what was logged last
  // Monotonic time at which the oldest entry not yet synced was offered; 0: none.
  std::int64_t oldest_unsafe_ns_ = 0;
  bool refuses_write_ = false, refuses_sync_ = false;  // the latest attempt failed
  bool names_image_ = false;                           // an unsynced event names an image: sync early
  bool blocked_ = false;  // the next input names an exposure that is not written yet
};

}  // namespace fathom::io

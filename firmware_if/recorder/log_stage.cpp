#include "firmware_if/recorder/log_stage.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <optional>

#include "firmware_if/mission/log/log_events.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kJournalMemory_bytes = std::size_t{4} << 20;  // minutes of inputs
constexpr std::uint64_t kLeastRoom_bytes = std::uint64_t{4} << 20;  // less is not worth taking

// Of a log that lost power before its first event was whole: its beginning, or what the disk gives for blocks
// that were never written. errno is set when the disk refuses.
bool beginsAsLog(int fd) {
  std::uint8_t first[4] = {};
  errno = 0;
  if (::pread(fd, first, sizeof first, 0) != sizeof first) return errno == 0;
  constexpr std::uint8_t kSync[4] = {0xED, 0xA1, 0xDA, 0x01}, kNothing[4] = {0, 0, 0, 0};
  return std::equal(first, first + 4, kSync) || std::equal(first, first + 4, kNothing);
}

[[noreturn]] void refuseForeign(const std::filesystem::path& path) {
  throw InputError(path, "", "exists and is no LCM event log; move it away");
}

// An input with its ACFR twin and two gaps before it.
constexpr std::size_t kMostInputBytes = 4096;
constexpr std::size_t kSpareToSync = std::size_t{3} << 20;  // of the journal's memory
constexpr std::size_t kMostFramingBytes = 256;              // of an event around its data

}  // namespace

JournalFile::JournalFile() {
  // Touched now, so that the first events find their memory there.
  memory_.resize(kJournalMemory_bytes);
  memory_.clear();
}

bool JournalFile::open(const std::filesystem::path& path, std::uint64_t room, std::uint64_t leave_free) {
  Descriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!file.open() && errno == EISDIR) refuseForeign(path);
  if (!file.open()) return refused("cannot be opened");
  if (!continueBehind(file.get(), path)) return false;
  file_ = std::move(file);
  takeRoom(room, leave_free);
  return true;
}

// Finds the end of the log, and cuts away what follows it.
bool JournalFile::continueBehind(int fd, const std::filesystem::path& path) {
  struct stat status = {};
  if (::fstat(fd, &status) != 0) return refused("cannot be looked at");
  if (!S_ISREG(status.st_mode)) refuseForeign(path);
  LogEnd end;
  if (status.st_size > 0) {
    try {
      end = findLogEnd(path);
    } catch (const InputError& e) {
      end.failure = e.what();
    }
    failure_ = end.failure;
    if (!end.failure.empty()) return false;
    if (end.offset == 0 && !beginsAsLog(fd)) {
      if (errno != 0) return refused("cannot be read");
      refuseForeign(path);
    }
  }
  if (::ftruncate(fd, static_cast<off_t>(end.offset)) != 0) return refused("cannot be continued");
  whole_at_start_ = synced_ = cached_from_ = end.offset;
  cut_at_start_ += static_cast<std::uint64_t>(status.st_size) - end.offset;
  next_number_ = end.next_number;
  return ::fsync(fd) == 0 || refused("cannot be synced to the disk");
}

bool JournalFile::refused(const char* what) noexcept {
  failure_ = std::string(what) + " (" + std::strerror(errno) + ")";
  return false;
}

void JournalFile::takeRoom(std::uint64_t room, std::uint64_t leave_free) noexcept {
  struct statvfs disk = {};
  if (::fstatvfs(file_.get(), &disk) != 0) return;
  const std::uint64_t free = std::uint64_t{disk.f_bavail} * disk.f_frsize;
  room = std::min(room, free > leave_free ? free - leave_free : 0);
  for (; room >= kLeastRoom_bytes; room /= 2) {
    if (::fallocate(file_.get(), FALLOC_FL_KEEP_SIZE, static_cast<off_t>(synced_),
                    static_cast<off_t>(room)) == 0 ||
        errno != ENOSPC)  // not every file system can
      return;
  }
}

std::size_t JournalFile::spare() const noexcept {
  return kJournalMemory_bytes - memory_.size();
}

void JournalFile::append(std::int64_t timestamp_us, std::string_view channel,
                         std::span<const std::uint8_t> data) {
  assert(logEventBytes(channel, data) <= spare());
  appendLogEvent(memory_, next_number_, timestamp_us, channel, data);
  ++next_number_;
}

bool JournalFile::write() noexcept {
  written_ += writeAt(file_.get(), std::span(memory_).subspan(written_), synced_ + written_);
  return written_ == memory_.size() || refused("cannot be written");
}

bool JournalFile::sync() noexcept {
  if (written_ == 0) return true;
  const bool good = ::fdatasync(file_.get()) == 0;
  if (good) {
    synced_ += written_;
    memory_.erase(memory_.begin(), memory_.begin() + static_cast<std::ptrdiff_t>(written_));
    dropFromCache();
  } else {
    (void)refused("cannot be synced to the disk");
  }
  written_ = 0;
  return good;
}

void JournalFile::dropFromCache() noexcept {
  constexpr std::uint64_t kPage = 4096;  // the last one is still written to
  const std::uint64_t whole_pages = synced_ / kPage * kPage;
  if (whole_pages <= cached_from_) return;
  ::posix_fadvise(file_.get(), static_cast<off_t>(cached_from_),
                  static_cast<off_t>(whole_pages - cached_from_), POSIX_FADV_DONTNEED);
  cached_from_ = whole_pages;
}

void JournalFile::close() noexcept {
  struct stat status = {};
  if (::fstat(file_.get(), &status) == 0 && ::ftruncate(file_.get(), status.st_size) == 0)
    (void)::fsync(file_.get());
}

LogStage::LogStage(const RecorderConfig& config, JournalFile& log, ImageStage& images)
    : config_(config), log_(log), images_(images) {
  for (std::size_t i = 0; i < config.raw_lanes; ++i)
    raw_.push_back(std::make_unique<RawLane>(config.raw_queue_kib * 1024));
}

std::uint64_t LogStage::rawRefused() const noexcept {
  std::uint64_t refused = 0;
  for (const auto& lane : raw_) refused += lane->refused();
  return refused;
}

bool LogStage::waiting() {
  RawLane::Entry entry;
  bool any = inputs_.front() != nullptr || decisions_.front() != nullptr;
  for (const auto& lane : raw_) any = any || lane->front(entry);
  return any;
}

void LogStage::drain(std::int64_t deadline, bool with_raw, const std::string& vehicle_name) {
  constexpr int kEntriesBetweenLooks = 64;
  RawLane::Entry entry, first_entry;
  if (!log_.isOpen())
    for (const auto& lane : raw_)
      while (lane->front(entry)) dropRaw(*lane);
  blocked_ = !log_.isOpen();
  for (int count = 1; !blocked_; ++count) {
    if (count % kEntriesBetweenLooks == 0 && clock_.monotonicNs() >= deadline) return;
    InputLane* first = nullptr;
    RawLane* first_raw = nullptr;
    std::int64_t first_utc_ns = 0;
    for (InputLane* lane : {&inputs_, &decisions_}) {
      const InputLane::Entry* front = lane->front();
      if (front == nullptr || (first != nullptr && front->input.arrival_utc_ns >= first_utc_ns)) continue;
      first = lane;
      first_utc_ns = front->input.arrival_utc_ns;
    }
    for (const auto& lane : raw_) {
      if (!lane->front(entry)) continue;
      if ((first != nullptr || first_raw != nullptr) && entry.arrival_utc_ns > first_utc_ns) continue;
      first_raw = lane.get();
      first_entry = entry;
      first_utc_ns = entry.arrival_utc_ns;
    }
    if (first_raw != nullptr) {
      if (!logRaw(*first_raw, first_entry, with_raw)) return;
    } else if (first == nullptr || !logInput(*first, vehicle_name)) {
      return;
    }
  }
}

bool LogStage::logInput(InputLane& lane, const std::string& vehicle_name) {
  if (log_.spare() < kMostInputBytes) return false;
  const InputLane::Entry& entry = *lane.front();
  const std::int64_t arrival = entry.input.arrival_utc_ns;
  const ImageEvent* image = imageOf(entry.input);
  std::optional<RecordingGap> image_gap;
  if (image != nullptr) {
    const ImageLane::State state = images_.stateOf(image->side, image->utc_ns);
    if (state == ImageLane::State::kWaiting) {
      blocked_ = true;
      return false;
    }
    if (state == ImageLane::State::kLost)
      image_gap = {arrival, RecordingGap::Kind::kImage, 1, image->file_name};
    images_.named(image->side, image->utc_ns);
    names_image_ = names_image_ || state == ImageLane::State::kWritten;
  }
  logMissing(lane, lane.missingBeforeFront(), arrival);
  if (image_gap) logGap(*image_gap);
  append(arrival, encodeInput(entry.input), entry.offered_ns);
  if (config_.acfr_channels)
    if (const auto* sample = std::get_if<SensorSample>(&entry.input.what))
      if (const auto twin = encodeAcfrTwin(*sample, vehicle_name)) append(arrival, *twin, entry.offered_ns);
  lane.pop();
  ++(&lane == &inputs_ ? counters_.inputs : counters_.decisions);
  return true;
}

bool LogStage::logRaw(RawLane& lane, const RawLane::Entry& entry, bool with_raw) {
  if (!with_raw) {
    dropRaw(lane);
    return true;
  }
  const std::uint64_t missing = counters_.raw_dropped + rawRefused();
  if (log_.spare() < entry.data.size() + kMostInputBytes + kMostFramingBytes) return false;
  if (missing > raw_missing_logged_)
    logGap({entry.arrival_utc_ns, RecordingGap::Kind::kRaw, missing - raw_missing_logged_, ""});
  raw_missing_logged_ = missing;
  const std::int64_t now = clock_.monotonicNs();
  if (entry.kind == RawLane::Kind::kRaw) {
    append(entry.arrival_utc_ns, {std::string(entry.channel), encodeRaw(entry.arrival_utc_ns, entry.data)},
           now);
    ++counters_.raw_entries;
  } else {
    append(entry.arrival_utc_ns,
           {std::string(entry.channel), std::vector<std::uint8_t>(entry.data.begin(), entry.data.end())},
           now);
    ++counters_.messages;
  }
  lane.pop();
  return true;
}

void LogStage::dropRaw(RawLane& lane) {
  ++counters_.raw_dropped;
  lane.pop();
}

void LogStage::logMissing(const InputLane& lane, std::uint64_t count, std::int64_t arrival_utc_ns) {
  if (count == 0) return;
  logGap({arrival_utc_ns, RecordingGap::Kind::kInputs, count,
          std::string(&lane == &decisions_ ? kGapOfDecisions : "")});
}

void LogStage::logGap(const RecordingGap& gap) {
  append(gap.arrival_utc_ns, encodeGap(gap), clock_.monotonicNs());
}

void LogStage::append(std::int64_t arrival_utc_ns, const LogMessage& message, std::int64_t offered_ns) {
  log_.append(arrival_utc_ns / kMicrosecond_ns, message.channel, message.data);
  newest_utc_ns_ = arrival_utc_ns;
  if (oldest_unsafe_ns_ == 0) oldest_unsafe_ns_ = offered_ns;
}

void LogStage::handOver() {
  if (!log_.isOpen()) return;
  refuses_write_ = !log_.write();
  if (refuses_write_) ++counters_.write_failures;
  syncIfDue();
}

void LogStage::syncIfDue() {
  if (oldest_unsafe_ns_ == 0) return;
  // Images go first only when the log can wait for them; once they are on the disk, so is soon what names
  // them.
  const bool images_wait = images_.waiting();
  const std::int64_t age = clock_.monotonicNs() + (images_wait ? images_.timeNs() : 0) - oldest_unsafe_ns_;
  const bool named = names_image_ && !images_wait;
  if (named || log_.spare() < kSpareToSync || age >= static_cast<std::int64_t>(config_.sync_interval_s * 1e9))
    sync();
}

void LogStage::sync() {
  if (!log_.unsynced()) return;
  const std::int64_t start = clock_.monotonicNs();
  const bool good = log_.sync();
  const std::int64_t end = clock_.monotonicNs();
  counters_.worst_sync_ns = std::max(counters_.worst_sync_ns, end - start);
  ++(good ? counters_.syncs : counters_.syncs_failed);
  refuses_sync_ = !good;
  if (!good) ++counters_.write_failures;
  if (!good || !log_.safe()) return;
  counters_.inputs_safe = counters_.inputs;
  counters_.inputs_passed = inputs_.next();
  counters_.decisions_passed = decisions_.next();
  if (oldest_unsafe_ns_ != 0)
    counters_.worst_unsafe_ns = std::max(counters_.worst_unsafe_ns, end - oldest_unsafe_ns_);
  oldest_unsafe_ns_ = 0;
  names_image_ = false;
}

bool LogStage::end() {
  if (!log_.isOpen() || log_.spare() < kMostInputBytes) return false;
  for (InputLane* lane : {&inputs_, &decisions_}) {
    logMissing(*lane, lane->missingAtEnd(), newest_utc_ns_);
    lane->passOverEnd();
  }
  handOver();
  sync();
  return log_.safe();
}

}  // namespace fathom::io

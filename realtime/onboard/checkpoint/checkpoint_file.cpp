#include "realtime/onboard/checkpoint/checkpoint_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::onboard {
namespace {

// A file that is not there has nothing to lose.
bool syncFile(const std::filesystem::path& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return errno == ENOENT;
  const bool good = ::fdatasync(file) == 0;
  ::close(file);
  return good;
}

namespace fs = std::filesystem;

constexpr std::uint64_t kMagic = 0x54504b434d485446ULL;  // "FTHMCKPT"
constexpr std::uint32_t kFormat = 1;
// No machine that this runs on holds more state [B].
constexpr std::uint64_t kMostState = std::uint64_t{1} << 32;

struct Start {
  std::uint64_t magic = kMagic;
  std::uint32_t format = kFormat;
  std::uint32_t head_crc = 0;
  CheckpointHead head;
  std::uint64_t state_bytes = 0;
  std::uint32_t state_crc = 0;
  std::uint32_t unused = 0;
};
static_assert(std::has_unique_object_representations_v<Start>);
constexpr std::size_t kCovered = offsetof(Start, head);  // the head's CRC is over what follows

std::uint32_t headCrc(const Start& start) {
  std::array<std::uint8_t, sizeof(Start)> bytes;
  std::memcpy(bytes.data(), &start, sizeof start);
  return crc32(std::span<const std::uint8_t>(bytes).subspan(kCovered));
}

bool writeAll(int file, std::span<const std::uint8_t> bytes, std::uint64_t offset) {
  constexpr std::size_t kAtOnce = 1 << 20;  // others want the disk, too
  for (std::size_t at = 0; at < bytes.size(); at += kAtOnce) {
    const auto part = bytes.subspan(at, std::min(bytes.size() - at, kAtOnce));
    if (writeAt(file, part, offset + at) < part.size()) return false;
  }
  return true;
}

// Why a file of so many bytes that begins like this is no checkpoint; empty: its head says that it is one.
std::string checkStart(const Start& start, std::uint64_t file_bytes) {
  if (start.magic != kMagic) return "it is no checkpoint";
  if (start.format != kFormat)
    return "it has format " + std::to_string(start.format) + ", not " + std::to_string(kFormat);
  if (start.head_crc != headCrc(start)) return "its head is damaged";
  if (start.state_bytes != file_bytes - sizeof start || start.state_bytes > kMostState)
    return "it was not written to its end";
  return "";
}

std::string checkState(const Start& start, std::span<const std::uint8_t> state) {
  if (crc32(state) != start.state_crc) return "its state is damaged";
  if (!rt::StateReader(state).sectionsAreWhole()) return "a part of its state is damaged";
  return "";
}

// A file that may be a checkpoint.
struct Opened {
  Descriptor file;
  Start start;
  bool whole_head = false;
  std::string why;  // it is none
};
// Nothing where there is no file.
std::optional<Opened> openStart(const fs::path& path) {
  Opened opened{Descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC)), {}, false, ""};
  if (!opened.file.open() && errno == ENOENT) return std::nullopt;
  struct stat found {};
  std::array<std::uint8_t, sizeof(Start)> bytes;
  const bool plain = opened.file.open() && ::fstat(opened.file.get(), &found) == 0 && S_ISREG(found.st_mode);
  if (plain && static_cast<std::uint64_t>(found.st_size) < bytes.size())
    opened.why = "it is too short for a checkpoint";
  else if (!plain || !readAt(opened.file.get(), bytes, 0))
    opened.why = "it cannot be read";
  if (!opened.why.empty()) return opened;
  std::memcpy(&opened.start, bytes.data(), bytes.size());
  opened.whole_head = opened.start.magic == kMagic && opened.start.head_crc == headCrc(opened.start);
  opened.why = checkStart(opened.start, static_cast<std::uint64_t>(found.st_size));
  return opened;
}

std::string passedOver(const fs::path& path, const std::string& why) {
  return path.string() + ": passed over, " + why;
}

}  // namespace

CheckpointWriter::CheckpointWriter(CheckpointFiles& files, std::size_t capacity,
                                   std::vector<std::filesystem::path> named)
    : files_(files), buffer_(capacity), named_(std::move(named)) {
  // A page that was never written is not there yet.
  std::fill(buffer_.begin(), buffer_.end(), std::uint8_t{1});
}

std::span<std::uint8_t> CheckpointWriter::begin() noexcept {
  if (!waiting_.load(std::memory_order_acquire)) return buffer_;
  late_.fetch_add(1, std::memory_order_relaxed);
  return {};
}

void CheckpointWriter::submit(const CheckpointHead& head, std::size_t bytes,
                              std::uint64_t decisions) noexcept {
  assert(bytes <= buffer_.size());
  head_ = head;
  bytes_ = bytes;
  decisions_ = decisions;
  waiting_.store(true, std::memory_order_release);
}

bool CheckpointWriter::work() {
  if (!waiting_.load(std::memory_order_acquire)) return false;
  const bool good = std::all_of(named_.begin(), named_.end(), syncFile) &&
                    files_.write(head_, std::span<const std::uint8_t>(buffer_).first(bytes_));
  if (good) {
    oldest_.store(std::exchange(newest_, head_.number), std::memory_order_relaxed);
    written_.fetch_add(1, std::memory_order_relaxed);
    last_bytes_.store(bytes_, std::memory_order_relaxed);
    utc_ns_.store(head_.utc_ns, std::memory_order_relaxed);
  } else {
    failed_.fetch_add(1, std::memory_order_relaxed);
  }
  waiting_.store(false, std::memory_order_release);
  return good;
}

CheckpointWriter::Counters CheckpointWriter::counters() const noexcept {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  return {written_.load(kRelaxed),   failed_.load(kRelaxed),     late_.load(kRelaxed),
          too_large_.load(kRelaxed), last_bytes_.load(kRelaxed), utc_ns_.load(kRelaxed)};
}

std::uint64_t checkpointHash(std::string_view bytes, std::uint64_t hash) noexcept {
  constexpr std::uint64_t kPrime = 0x100000001b3ULL;
  for (const char c : bytes) hash = (hash ^ static_cast<std::uint8_t>(c)) * kPrime;
  return hash;
}

std::string decodeCheckpoint(std::span<const std::uint8_t> bytes, CheckpointHead& head,
                             std::span<const std::uint8_t>& state) {
  Start start;
  if (bytes.size() < sizeof start) return "it is too short for a checkpoint";
  std::memcpy(&start, bytes.data(), sizeof start);
  std::string why = checkStart(start, bytes.size());
  if (why.empty()) why = checkState(start, bytes.subspan(sizeof start));
  if (!why.empty()) return why;
  head = start.head;
  state = bytes.subspan(sizeof start);
  return "";
}

CheckpointFiles::CheckpointFiles(fs::path folder)
    : folder_(std::move(folder)), paths_{folder_ / "checkpoint-0.bin", folder_ / "checkpoint-1.bin"} {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) throw InputError(folder_.string(), "checkpoints", "cannot be made: " + error.message());
}

fs::path CheckpointFiles::file(std::uint64_t number) const {
  for (const fs::path& path : paths_)
    if (const auto opened = openStart(path); opened && opened->why.empty())
      if (opened->start.head.number == number) return path;
  return {};
}

std::uint64_t CheckpointFiles::newestNumber() const {
  std::uint64_t newest = 0;
  for (const fs::path& path : paths_)
    if (const auto opened = openStart(path); opened && opened->whole_head)
      newest = std::max(newest, opened->start.head.number);
  return newest;
}

// Not the one that is kept; else one that is not usable beside that head, else the older.
std::size_t CheckpointFiles::placeFor(const CheckpointHead& head) const {
  if (kept_) return 1 - *kept_;
  std::array<std::uint64_t, kFiles> numbers{};  // 0: not usable
  for (std::size_t k = 0; k < kFiles; ++k)
    if (const auto opened = openStart(paths_[k]); opened && opened->why.empty()) {
      const CheckpointHead& there = opened->start.head;
      if (there.mission == head.mission && there.configuration == head.configuration)
        numbers[k] = there.number;
    }
  return numbers[1] < numbers[0] ? 1 : 0;
}

bool CheckpointFiles::write(const CheckpointHead& head, std::span<const std::uint8_t> state) noexcept {
  Start start;
  start.head = head;
  start.state_bytes = state.size();
  start.state_crc = crc32(state);
  start.head_crc = headCrc(start);
  std::array<std::uint8_t, sizeof start> first;
  std::memcpy(first.data(), &start, sizeof start);

  const std::size_t place = placeFor(head);
  const fs::path temporary = folder_ / "checkpoint.tmp";
  const auto refused = [&](const char* what) {
    error_ = std::string(what) + ": " + std::strerror(errno);
    ::unlink(temporary.c_str());
    return false;
  };
  constexpr int kMode = 0644;
  {
    const Descriptor out(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kMode));
    if (!out.open()) return refused("cannot be made");
    if (!writeAll(out.get(), first, 0) || !writeAll(out.get(), state, first.size()))
      return refused("cannot be written");
    if (::fdatasync(out.get()) != 0) return refused("cannot be brought to the disk");
    // Nobody reads it soon: the memory is others'.
    (void)::posix_fadvise(out.get(), 0, 0, POSIX_FADV_DONTNEED);
  }
  if (::rename(temporary.c_str(), paths_[place].c_str()) != 0) return refused("cannot be named");
  kept_ = place;
  if (!syncPath(folder_.c_str())) return refused("its name cannot be brought to the disk");
  error_.clear();
  return true;
}

std::vector<CheckpointHead> CheckpointFiles::usable(std::uint64_t configuration, std::uint64_t mission,
                                                    std::vector<std::string>& said) const {
  std::vector<CheckpointHead> heads;
  for (const fs::path& path : paths_) {
    const auto opened = openStart(path);
    if (!opened) continue;
    const CheckpointHead& head = opened->start.head;
    std::string why = opened->why;
    if (why.empty() && head.mission != mission) why = "it is of another mission";
    if (why.empty() && head.configuration != configuration)
      why = "it was written by another program or configuration";
    if (why.empty())
      heads.push_back(head);
    else
      said.push_back(passedOver(path, why));
  }
  std::sort(heads.begin(), heads.end(),
            [](const CheckpointHead& a, const CheckpointHead& b) { return a.number > b.number; });
  return heads;
}

// `room` is asked for as many bytes as the state has, and may give fewer: then there is no room.
bool CheckpointFiles::readInto(std::uint64_t number, const Room& room, std::vector<std::string>& said) {
  for (std::size_t k = 0; k < kFiles; ++k) {
    const auto opened = openStart(paths_[k]);
    if (!opened || !opened->why.empty() || opened->start.head.number != number) continue;
    const std::span<std::uint8_t> state = room(opened->start.head, opened->start.state_bytes);
    std::string why;
    if (state.size() < opened->start.state_bytes)
      why = "its state of " + std::to_string(opened->start.state_bytes) + " bytes has no room in the " +
            std::to_string(state.size()) + " bytes for one";
    else
      why = readAt(opened->file.get(), state, sizeof(Start)) ? checkState(opened->start, state)
                                                             : "it cannot be read";
    if (why.empty()) {
      kept_ = k;
      return true;
    }
    said.push_back(passedOver(paths_[k], why));
  }
  return false;
}

std::optional<CheckpointFiles::Found> CheckpointFiles::read(std::uint64_t number,
                                                            std::vector<std::string>& said) {
  Found found;
  const Room room = [&](const CheckpointHead& head, std::uint64_t bytes) {
    found.head = head;
    found.state.resize(bytes);
    return std::span<std::uint8_t>(found.state);
  };
  if (!readInto(number, room, said)) return std::nullopt;
  return found;
}

std::optional<std::span<const std::uint8_t>> CheckpointFiles::read(std::uint64_t number,
                                                                   std::span<std::uint8_t> room,
                                                                   std::vector<std::string>& said) {
  std::span<std::uint8_t> state;
  const Room given = [&](const CheckpointHead&, std::uint64_t bytes) {
    return state = room.first(std::min<std::uint64_t>(bytes, room.size()));
  };
  if (!readInto(number, given, said)) return std::nullopt;
  return state;
}

std::optional<CheckpointFiles::Found> CheckpointFiles::readStart(std::uint64_t number, std::size_t bytes,
                                                                 std::vector<std::string>& said) const {
  for (const fs::path& path : paths_) {
    const auto opened = openStart(path);
    if (!opened || !opened->why.empty() || opened->start.head.number != number) continue;
    Found found{opened->start.head,
                std::vector<std::uint8_t>(std::min<std::uint64_t>(bytes, opened->start.state_bytes))};
    if (readAt(opened->file.get(), found.state, sizeof(Start))) return found;
    said.push_back(passedOver(path, "it cannot be read"));
  }
  return std::nullopt;
}

std::optional<CheckpointFiles::Found> CheckpointFiles::readNewest(std::uint64_t configuration,
                                                                  std::uint64_t mission,
                                                                  std::vector<std::string>& said) {
  for (const CheckpointHead& head : usable(configuration, mission, said))
    if (auto found = read(head.number, said)) return found;
  return std::nullopt;
}

void CheckpointFiles::remove(std::uint64_t number) noexcept {
  const fs::path path = file(number);
  if (kept_ && paths_[*kept_] == path) kept_.reset();
  std::error_code ignored;
  fs::remove(path, ignored);
}

void CheckpointFiles::remove() noexcept {
  std::error_code ignored;
  for (const fs::path& path : paths_) fs::remove(path, ignored);
  kept_.reset();
}

}  // namespace fathom::onboard

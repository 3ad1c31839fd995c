#include "realtime/onboard/checkpoint/checkpoint_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>

#include "realtime/kernel/crc32.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/state_archive.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMagic = 0x54504b434d485446ULL;  // "FTHMCKPT"
constexpr std::uint32_t kFormat = 1;
constexpr std::size_t kFiles = 2;
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

// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int file) : file_(file) {}
  ~Descriptor() {
    if (file_ >= 0) ::close(file_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const { return file_; }

 private:
  int file_;
};

bool writeAll(int file, std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kAtOnce = 1 << 20;  // others want the disk, too
  while (!bytes.empty()) {
    const ssize_t done = ::write(file, bytes.data(), std::min(bytes.size(), kAtOnce));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(done));
  }
  return true;
}

bool readAll(const fs::path& path, std::vector<std::uint8_t>& bytes) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  const off_t end = file.get() < 0 ? -1 : ::lseek(file.get(), 0, SEEK_END);
  if (end < 0 || static_cast<std::uint64_t>(end) > kMostState + sizeof(Start)) return false;
  bytes.resize(static_cast<std::size_t>(end));
  std::size_t at = 0;
  while (at < bytes.size()) {
    const ssize_t done = ::pread(file.get(), bytes.data() + at, bytes.size() - at, static_cast<off_t>(at));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    at += static_cast<std::size_t>(done);
  }
  return true;
}

}  // namespace

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
  if (start.magic != kMagic) return "it is no checkpoint";
  if (start.format != kFormat)
    return "it has format " + std::to_string(start.format) + ", not " + std::to_string(kFormat);
  if (start.head_crc != headCrc(start)) return "its head is damaged";
  if (start.state_bytes != bytes.size() - sizeof start) return "it was not written to its end";
  const std::span<const std::uint8_t> content = bytes.subspan(sizeof start);
  if (crc32(content) != start.state_crc) return "its state is damaged";
  if (!rt::StateReader(content).sectionsAreWhole()) return "a part of its state is damaged";
  head = start.head;
  state = content;
  return "";
}

CheckpointFiles::CheckpointFiles(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) throw InputError(folder_.string(), "checkpoints", "cannot be made: " + error.message());
}

fs::path CheckpointFiles::file(std::uint64_t number) const {
  return folder_ / ("checkpoint-" + std::to_string(number % kFiles) + ".bin");
}

bool CheckpointFiles::write(const CheckpointHead& head, std::span<const std::uint8_t> state) noexcept {
  Start start;
  start.head = head;
  start.state_bytes = state.size();
  start.state_crc = crc32(state);
  start.head_crc = headCrc(start);
  std::array<std::uint8_t, sizeof start> first;
  std::memcpy(first.data(), &start, sizeof start);

  const fs::path temporary = folder_ / "checkpoint.tmp", place = file(head.number);
  const auto refused = [&](const char* what) {
    error_ = std::string(what) + ": " + std::strerror(errno);
    ::unlink(temporary.c_str());
    return false;
  };
  constexpr int kMode = 0644;
  {
    const Descriptor out(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kMode));
    if (out.get() < 0) return refused("cannot be made");
    if (!writeAll(out.get(), first) || !writeAll(out.get(), state)) return refused("cannot be written");
    if (::fdatasync(out.get()) != 0) return refused("cannot be brought to the disk");
    // Nobody reads it soon: the memory is others'.
    (void)::posix_fadvise(out.get(), 0, 0, POSIX_FADV_DONTNEED);
  }
  if (::rename(temporary.c_str(), place.c_str()) != 0) return refused("cannot be named");
  const Descriptor here(::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (here.get() < 0 || ::fsync(here.get()) != 0) return refused("its name cannot be brought to the disk");
  error_.clear();
  return true;
}

std::optional<CheckpointFiles::Found> CheckpointFiles::readNewest(std::uint64_t configuration,
                                                                  std::uint64_t mission,
                                                                  std::vector<std::string>& said) const {
  std::optional<Found> newest;
  for (std::uint64_t k = 0; k < kFiles; ++k) {
    const fs::path path = file(k);
    std::error_code error;
    if (!fs::exists(path, error)) continue;
    Found found;
    std::vector<std::uint8_t> bytes;
    std::span<const std::uint8_t> state;
    std::string why = readAll(path, bytes) ? decodeCheckpoint(bytes, found.head, state) : "it cannot be read";
    if (why.empty() && found.head.mission != mission) why = "it is of another mission";
    if (why.empty() && found.head.configuration != configuration)
      why = "it was written by another program or configuration";
    if (!why.empty()) {
      said.push_back(path.string() + ": passed over, " + why);
      continue;
    }
    if (newest && newest->head.number > found.head.number) continue;
    bytes.erase(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(sizeof(Start)));
    found.state = std::move(bytes);
    newest = std::move(found);
  }
  return newest;
}

void CheckpointFiles::remove(std::uint64_t number) noexcept {
  std::error_code ignored;
  fs::remove(file(number), ignored);
}

void CheckpointFiles::remove() noexcept {
  std::error_code ignored;
  for (std::uint64_t k = 0; k < kFiles; ++k) fs::remove(file(k), ignored);
}

}  // namespace fathom::onboard

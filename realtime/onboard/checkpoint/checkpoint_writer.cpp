#include "realtime/onboard/checkpoint/checkpoint_writer.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <utility>

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

}  // namespace fathom::onboard

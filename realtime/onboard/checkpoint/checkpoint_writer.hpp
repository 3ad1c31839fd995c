#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "realtime/onboard/checkpoint/checkpoint_file.hpp"

namespace fathom::onboard {

// Transfers saved state from one thread, which never waits, to the disk by another. One buffer: while it is
// being written, the next checkpoint that is due is left out and counted.
//
//   soft tier:    if (auto buffer = writer.begin(); !buffer.empty()) { StateWriter w(buffer); ... save ...
//                   w.full() ? writer.giveUp() : writer.submit(head, w.size()); }
//   best effort:  writer.work() repeatedly, some times a second
class CheckpointWriter {
 public:
  // `capacity`: of the state [B]; taken and touched at once. `named`: files that a checkpoint relies on; they
  // are brought to the disk before it.
  CheckpointWriter(CheckpointFiles& files, std::size_t capacity, std::vector<std::filesystem::path> named);

  // Soft tier. Empty while the last one is still being written.
  [[nodiscard]] std::span<std::uint8_t> begin() noexcept;
  // `decisions`: number made by then, for waiting until the log has them.
  void submit(const CheckpointHead& head, std::size_t bytes, std::uint64_t decisions = 0) noexcept;
  void giveUp() noexcept { too_large_.fetch_add(1, std::memory_order_relaxed); }  // it does not fit

  // Best effort.
  [[nodiscard]] bool waiting() const noexcept { return waiting_.load(std::memory_order_acquire); }
  // Of the one that waits.
  [[nodiscard]] const CheckpointHead& head() const noexcept { return head_; }
  [[nodiscard]] std::uint64_t decisions() const noexcept { return decisions_; }
  // Writes the checkpoint that waits, if one does; true when it did.
  bool work();

  struct Counters {
    std::uint64_t written = 0, failed = 0, late = 0, too_large = 0;
    std::uint64_t bytes = 0;  // of the last one
    std::int64_t utc_ns = 0;  // of the last one that is on the disk
  };
  [[nodiscard]] Counters counters() const noexcept;
  // Number of the last but one written: a restart needs none before it. 0: unknown.
  [[nodiscard]] std::uint64_t oldest() const noexcept { return oldest_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t capacity() const { return buffer_.size(); }

 private:
  CheckpointFiles& files_;
  std::vector<std::uint8_t> buffer_;
  std::vector<std::filesystem::path> named_;
  CheckpointHead head_;
  std::size_t bytes_ = 0;
  std::uint64_t decisions_ = 0;
  std::uint64_t newest_ = 0;          // number of the last one written; best effort
  std::atomic<bool> waiting_{false};  // the buffer is the best effort's
  std::atomic<std::uint64_t> written_{0}, failed_{0}, late_{0}, too_large_{0}, last_bytes_{0};
  std::atomic<std::uint64_t> oldest_{0};
  std::atomic<std::int64_t> utc_ns_{0};
};

}  // namespace fathom::onboard

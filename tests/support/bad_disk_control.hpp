#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace fathom::test {

// What goes wrong with a system call.
//   kNoSpace      ENOSPC; usually making a file or a folder, writing, taking room
//   kReadOnly     EROFS; usually every call that changes something
//   kInputOutput  EIO; usually every call
//   kStall        the call takes longer; usually every call
//   kShortWrite   the first write takes half of its bytes, those after it none (ENOSPC)
enum class DiskFault : std::uint32_t { kNone, kNoSpace, kReadOnly, kInputOutput, kStall, kShortWrite };

enum DiskCall : std::uint32_t {
  kOpenCall = 1,
  kReadCall = 2,
  kWriteCall = 4,
  kSyncCall = 8,
  kTruncateCall = 16,
  kAllocateCall = 32,
  kRenameCall = 64,
  kUnlinkCall = 128,
  kMakeFolderCall = 256,
};

struct BadDiskRule {
  // Stored last when a rule is set.
  std::atomic<DiskFault> fault{DiskFault::kNone};
  std::atomic<std::uint32_t> calls{0};  // DiskCall; 0: those that the fault usually has
  std::atomic<std::uint32_t> stall_ms{0};
  char path[64] = {};
  std::atomic<std::uint64_t> after{0}, times{0};
  std::atomic<std::int64_t> until_ns{0};  // of CLOCK_MONOTONIC; 0: without end
  std::atomic<std::uint64_t> seen{0};     // calls that it fits
  std::atomic<std::uint64_t> hit{0};      // calls that it spoilt
};

// The memory that a test shares with libfathom_bad_disk.so in the program under test: the file that the
// environment variable FATHOM_BAD_DISK names. Zeros are a disk that is well.
struct BadDiskControl {
  static constexpr std::size_t kRules = 8;
  char folder[512] = {};  // absolute; files elsewhere are never touched
  BadDiskRule rules[kRules];
};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

// Of a program that links fathom_bad_disk_here: from now on this control; nullptr: none.
extern "C" void fathomBadDiskUse(BadDiskControl* control) __attribute__((weak));

}  // namespace fathom::test

#pragma once

#include <atomic>
#include <cstdint>

namespace fathom::test {

// What a part of the program does when it comes to its fault point (realtime/kernel/fault_point.hpp).
//   kHangShort  for a second; kHang: for ever
//   kSlow       its work takes ten times as long
//   kCorrupt    nothing there: the part is given other input
enum class PartFault : std::uint32_t {
  kNone,
  kThrow,
  kAbort,
  kSegmentation,
  kKill,
  kHangShort,
  kHang,
  kSlow,
  kCorrupt
};

// The memory that a test shares with the programs under test: the file that the environment variable
// FATHOM_BAD_PARTS names. Zeros are parts that are well.
struct BadPartsControl {
  std::atomic<PartFault> fault{PartFault::kNone};  // stored last
  char part[32] = {};
  std::atomic<std::int64_t> until_ns{0};  // of CLOCK_MONOTONIC: kSlow and kCorrupt end
  std::atomic<std::uint64_t> hit{
      0};  // passes since it was set; all but kSlow and kCorrupt act on the first alone
};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

// That of the environment; nullptr where it names none.
extern "C" BadPartsControl* fathomBadParts();

}  // namespace fathom::test

#pragma once

#include <atomic>
#include <cstring>
#include <string>

#include "realtime/base/units.hpp"
#include "tests/support/mapped_file.hpp"

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

// A part of the programs under test that fails when the test says so: of those that are started with
// environment() and have libfathom_bad_disk.so loaded, or link fathom_bad_disk_here.
class BadParts {
 public:
  explicit BadParts(const std::filesystem::path& file) : file_(file), control_(file) {}

  // At the part's next fault point; kSlow and kCorrupt for so long.
  void set(const char* part, PartFault fault, std::int64_t for_ms) {
    std::strncpy(control_->part, part, sizeof control_->part - 1);
    control_->until_ns = nowNs() + for_ms * kMillisecond_ns;
    control_->fault = fault;
  }
  void clear() { control_->fault = PartFault::kNone; }
  [[nodiscard]] bool hit() const { return control_->hit > 0; }
  // NAME=value.
  [[nodiscard]] std::string environment() const { return "FATHOM_BAD_PARTS=" + file_.string(); }

 private:
  std::filesystem::path file_;
  MappedFile<BadPartsControl> control_;
};

}  // namespace fathom::test

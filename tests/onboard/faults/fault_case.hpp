#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/bad_disk.hpp"
#include "tests/support/bad_parts_control.hpp"

namespace fathom::test {

// What a part's fault ends, where it ends a process.
enum class PartOf : std::uint8_t { kNothing, kVehicle, kMapper };

// What goes wrong in one dive: in a part, at the disk, or both.
struct FaultCase {
  const char* part = "";
  PartOf process = PartOf::kNothing;
  PartFault fault = PartFault::kNone;
  BadDisk::Order disk;
  double after_s = 0;  // from the moment that the vehicle maps
  double apart_s = 0;  // from the part's to the disk's

  [[nodiscard]] std::string name() const;
  [[nodiscard]] bool hangs() const { return fault == PartFault::kHang; }
  // The vehicle process does not live on, at once or when it is found to hang.
  [[nodiscard]] bool endsVehicle() const;
  [[nodiscard]] bool is(const char* a_part, PartFault a_fault) const;
};

// How long kSlow, kCorrupt and what is wrong with the disk last.
inline constexpr std::int64_t kFaultFor_ms = 1000;

// Every fault of a part alone, every one of the disk alone, every one of the whole mapper with every one of
// the disk, every other of a part with one of the disk; then any of these, or of a part with any of the disk.
// The times are drawn.
[[nodiscard]] FaultCase faultCase(unsigned seed, int number);
[[nodiscard]] int systematicCases();

}  // namespace fathom::test

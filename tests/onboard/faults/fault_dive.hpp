#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "tests/support/bad_disk.hpp"

namespace fathom::test {

// What is done to the mapper process.
enum class MapperFault : std::uint8_t { kNone, kKill, kSegmentation, kAbort, kHangsShort, kHangs, kSlow };
inline constexpr int kMapperFaults = 7;

// What goes wrong in one dive: at the mapper, at the disk, or at both at once.
struct FaultCase {
  MapperFault mapper = MapperFault::kNone;
  BadDisk::Order disk;
  double apart_s = 0;  // from the one to the other
  [[nodiscard]] std::string name() const;
};
// All faults alone, then every pair of them, then any at random times; the times are drawn.
[[nodiscard]] FaultCase faultCase(unsigned seed, int number);
[[nodiscard]] int systematicCases();

// Dives with it, through the live program's vehicle process in this one and fathom-onboard as its mapper, and
// judges: a line on stdout, "good ..." or "BAD ... why". This process must have the disk's library loaded.
int faultDive(const std::filesystem::path& mission, const std::filesystem::path& out, unsigned seed,
              int number);

}  // namespace fathom::test

#pragma once

#include <sys/types.h>

#include "tests/support/bad_disk.hpp"
#include "tests/support/bad_parts.hpp"

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

// PartFault::kCorrupt of a part whose input is not a device's: what it has from the disk, or what the mapper
// process wrote into the memory that it shares with the vehicle, becomes noise. The mapper is then killed
// where it would not look at it otherwise.
//   supervisor  all that the mapper shared, once     publisher  its map's state and figures
//   link        its frames to the modem              stereo     half of each image on the disk
//   graph       the slots of features and meshes     map        the log: some bytes in its middle
//   output      rows on the disk                     checkpoints  the newest saved state
void damage(const FaultCase& fault, const std::filesystem::path& dive, pid_t mapper, unsigned seed);
// What the recording then replays to is something else: it is damaged itself, or the dive's map lacks meshes
// whose slots were damaged, which it counts.
[[nodiscard]] bool replaysToOther(const FaultCase& fault);

// Dives with the fault, in a vehicle process that is kept as the system's service manager keeps it, and
// judges: a line on stdout, "good ..." or "BAD ... why". Seconds are the machine's; what the machine took
// from the programs meanwhile is allowed on top of each limit. Exit status.
int faultDive(const std::filesystem::path& mission, const std::filesystem::path& out, unsigned seed,
              int number);

}  // namespace fathom::test

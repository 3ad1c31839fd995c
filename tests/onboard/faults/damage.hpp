#pragma once

#include <sys/types.h>

#include <filesystem>

#include "tests/onboard/faults/fault_case.hpp"

namespace fathom::test {

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

}  // namespace fathom::test

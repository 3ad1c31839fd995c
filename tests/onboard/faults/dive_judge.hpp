#pragma once

#include <string>
#include <vector>

#include "tests/onboard/faults/fault_case.hpp"
#include "tests/onboard/faults/vehicle_process.hpp"

namespace fathom::test {

// What happened in one dive; times of the vehicle, or seconds of the machine.
struct DiveStory {
  bool mapped = false, back = false, ended = false;
  bool saves = true;  // states, after a fault of what saves them
  std::int64_t fault_ns = 0, back_ns = 0, end_ns = 0;
  double fault_s = 0;  // that it took to do the fault
  double back_s = 0;   // from then until navigation ran and the map followed
  double end_s = 0;
  // What the machine took from the programs meanwhile, and from navigation's thread at all.
  double waited_back_s = 0, waited_end_s = 0, navigation_waited_s = 0;
  std::vector<VehicleProcess::Away> away;
};

// What is wrong with it; "" where nothing is. Replays the dive.
[[nodiscard]] std::string judge(const FaultCase& fault, const DiveStory& story, const VehicleSeen& seen,
                                const VehiclePlaces& places);

}  // namespace fathom::test

#pragma once

#include <filesystem>

#include "tests/onboard/faults/fault_case.hpp"

namespace fathom::test {

// Dives with the fault, in a vehicle process that is kept as the system's service manager keeps it, and
// judges: a line on stdout, "good ..." or "BAD ... why". Seconds are the machine's; what the machine took
// from the programs meanwhile is allowed on top of each limit. Exit status.
int faultDive(const std::filesystem::path& mission, const std::filesystem::path& out, unsigned seed,
              int number);

}  // namespace fathom::test

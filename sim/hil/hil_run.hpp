#pragma once

#include "sim/hil/hil_options.hpp"

namespace fathom::sim {

// fathom-sim hil: plays the mission through real interfaces to the real program, with the script's faults,
// and compares. Exit code: 0 when the program ended well and every check holds, 1 otherwise. Throws
// InputError.
int runHil(const HilOptions& options);

}  // namespace fathom::sim

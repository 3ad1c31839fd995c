#pragma once

#include "realtime/base/command_line.hpp"

namespace fathom::uml {

// Cuts the power of a recording machine at random instants; a table of what each cut cost.
void powerCutReport(CommandLine& program);

}  // namespace fathom::uml

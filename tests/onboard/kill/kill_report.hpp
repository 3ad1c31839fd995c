#pragma once

#include "tests/support/report_program.hpp"

namespace fathom::test {

// Kills the program on a dive again and again, and tells what that cost.
[[nodiscard]] Report killReport();
// The program that it kills: started by it, as a subcommand of the same program.
[[nodiscard]] Report killedDive();

}  // namespace fathom::test

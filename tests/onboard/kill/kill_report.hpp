#pragma once

#include "tests/support/report_program.hpp"

namespace fathom::test {

// Kills the program on a dive repeatedly and reports the cost.
[[nodiscard]] Report killReport();
// The program that it kills: started by it, as a subcommand of the same program.
[[nodiscard]] Report killedDive();

// What a machine that loses its power costs the live program.
[[nodiscard]] Report powerReport();

}  // namespace fathom::test

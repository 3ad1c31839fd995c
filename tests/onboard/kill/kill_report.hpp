#pragma once

#include "realtime/base/command_line.hpp"

namespace fathom::test {

// Kills the program on a dive repeatedly and reports the cost.
void killReport(CommandLine& program);
// The program that it kills: started by it, as a subcommand of the same program.
void killedDive(CommandLine& program);

// What a machine that loses its power costs the live program.
void powerReport(CommandLine& program);

}  // namespace fathom::test

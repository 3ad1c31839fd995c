#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::sim {

// Adds `fathom-sim replay` to the program: a replay of the vehicle's cores that speaks with a simulated ship;
// `command` is set to it. Returns what to run when it was chosen (exit code; throws InputError).
std::function<int()> addReplayCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::sim

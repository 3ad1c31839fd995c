#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::sim {

// Adds `fathom-sim channel` to the program; `command` is set to it. Returns what to run when it
// was chosen (exit code; throws InputError).
std::function<int()> addChannelCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::sim

#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::sim {

// Adds `fathom-sim picture` to the program; `command` is set to it. Returns what to run when it was chosen
// (exit code; throws InputError).
std::function<int()> addPictureCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::sim

#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::sim {

// fathom-sim hil and hil-compare: each adds its command and gives what runs it.
std::function<int()> addHilCommand(CLI::App& app, CLI::App*& command);
std::function<int()> addHilCompareCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::sim

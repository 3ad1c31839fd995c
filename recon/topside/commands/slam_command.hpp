#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside slam`: the poses of a mission and the page about them, without a map.
// Gives what to run once the command line has been parsed.
[[nodiscard]] std::function<int()> addSlamCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

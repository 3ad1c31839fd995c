#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside view FOLDER [--port N]`: serves a dive's output to a browser on this machine until it is
// interrupted. Gives what to run once the command line has been parsed.
[[nodiscard]] std::function<int()> addViewCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside check-tiles FOLDER [--json]`: whether a model's tiles are whole and join without cracks.
// Adds the sub-command; the function runs it and gives the exit code: 0 good, 1 with a line for each fault.
[[nodiscard]] std::function<int()> addCheckTilesCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

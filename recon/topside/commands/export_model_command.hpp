#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside export-model FOLDER --FORMAT FILE ...`: what a finished run can be handed on as. Of the
// results alone: a level of the tiles as one mesh. Of the mission with its work folder: where the cameras
// were, with points. Adds the sub-command; the function runs it and gives the exit code.
[[nodiscard]] std::function<int()> addExportModelCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside export-model FOLDER [--level N] [--ply FILE] [--obj FILE]`: one level of a model's tiles as
// one mesh for other tools. Adds the sub-command; the function runs it and gives the exit code.
[[nodiscard]] std::function<int()> addExportModelCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

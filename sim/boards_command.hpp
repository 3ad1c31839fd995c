#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::sim {

// Adds `boards` to the program's commands; the function runs it and gives the exit code.
[[nodiscard]] std::function<int()> addBoardsCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::sim

#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::sim {

// Adds the command `camera`, a simulated GigE Vision camera, to the program; returns what runs it.
[[nodiscard]] std::function<int()> addCameraCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::sim

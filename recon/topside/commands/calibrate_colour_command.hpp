#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

[[nodiscard]] std::function<int()> addCalibrateColourCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

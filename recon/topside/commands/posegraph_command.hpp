#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside posegraph`: optimises a g2o file of 3D poses and says how far down chi2 came, in what time.
// Gives what to run once the command line has been parsed.
[[nodiscard]] std::function<int()> addPosegraphCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

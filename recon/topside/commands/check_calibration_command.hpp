#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside check-calibration`: of a rig on photographs of a chessboard (--board), or of a mission on
// its own images. Adds the sub-command; the function runs it and gives the exit code: 0 good, 1 not.
[[nodiscard]] std::function<int()> addCheckCalibrationCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside compare SURVEY --reference FILE`: a survey beside gridded multibeam or another dive. Gives
// what to run once the command line has been parsed.
[[nodiscard]] std::function<int()> addCompareCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside

#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>

#include "recon/compare/surface_file.hpp"

namespace fathom::topside {

// `fathom-topside compare SURVEY --reference FILE`: a survey beside gridded multibeam or another dive. Gives
// what to run once the command line has been parsed.
[[nodiscard]] std::function<int()> addCompareCommand(CLI::App& app, CLI::App*& command);

// Where the nav frame of a mesh is: what stands beside it says so, or the mission folder that it is in.
[[nodiscard]] compare::PlaneFrame frameBeside(const std::filesystem::path& mesh);

}  // namespace fathom::topside

#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <vector>

namespace fathom::topside {

// A command and what runs it.
struct RunCommand {
  CLI::App* app = nullptr;
  std::function<int()> run;
};

// `fathom-topside run`, `stage` and `plan`: a whole dive, one of its stages, and of how many items these
// consist.
[[nodiscard]] std::vector<RunCommand> addRunCommands(CLI::App& app);

}  // namespace fathom::topside

#include <CLI/CLI.hpp>
#include <functional>
#include <utility>
#include <vector>

#include "realtime/base/command_line.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/version.hpp"
#include "recon/topside/commands/calibrate_colour_command.hpp"
#include "recon/topside/commands/calibrate_command.hpp"
#include "recon/topside/commands/check_calibration_command.hpp"
#include "recon/topside/commands/check_tiles_command.hpp"
#include "recon/topside/commands/compare_command.hpp"
#include "recon/topside/commands/export_model_command.hpp"
#include "recon/topside/commands/posegraph_command.hpp"
#include "recon/topside/commands/run_command.hpp"
#include "recon/topside/commands/slam_command.hpp"
#include "recon/topside/commands/stereo_command.hpp"
#include "recon/topside/commands/view_command.hpp"

int main(int argc, char** argv) {
  using namespace fathom::topside;
  CLI::App app{"fathom-topside: from a recorded dive to a model that people explore"};
  app.footer(
      "Examples: fathom-topside run missions/reef-grid\n"
      "          fathom-topside view missions/reef-grid\n"
      "Each command has a --help of its own.");
  app.set_version_flag("--version", fathom::versionLine("fathom-topside"));
  app.require_subcommand(1);
  std::vector<RunCommand> commands = addRunCommands(app);
  const auto add = [&](std::function<int()> (*adder)(CLI::App&, CLI::App*&)) {
    CLI::App* command = nullptr;
    std::function<int()> run = adder(app, command);
    commands.push_back({command, std::move(run)});
  };
  add(addExportModelCommand);
  add(addCheckTilesCommand);
  add(addCompareCommand);
  add(addViewCommand);
  add(addStereoCommand);
  add(addSlamCommand);
  add(addPosegraphCommand);
  add(addCalibrateCommand);
  add(addCalibrateColourCommand);
  add(addCheckCalibrationCommand);
  if (const auto code = fathom::parseCommandLine("fathom-topside", app, argc, argv)) return *code;
  return fathom::runTool("fathom-topside", [&]() -> int {
    for (const RunCommand& command : commands)
      if (*command.app) return command.run();
    return fathom::kExitBadInput;
  });
}

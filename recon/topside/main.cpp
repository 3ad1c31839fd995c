#include <CLI/CLI.hpp>
#include <functional>
#include <utility>
#include <vector>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/topside/calibrate_command.hpp"
#include "recon/topside/check_calibration_command.hpp"
#include "recon/topside/compare/compare_command.hpp"
#include "recon/topside/output/check_tiles_command.hpp"
#include "recon/topside/output/export_model_command.hpp"
#include "recon/topside/posegraph_command.hpp"
#include "recon/topside/run_command.hpp"
#include "recon/topside/slam_command.hpp"
#include "recon/topside/stereo_command.hpp"
#include "recon/topside/view/view_command.hpp"

int main(int argc, char** argv) {
  using namespace fathom::topside;
  CLI::App app{"fathom-topside: from a recorded dive to a model that people explore"};
  app.set_version_flag("--version", FATHOM_VERSION);
  app.require_subcommand(1);
  std::vector<Command> commands = addRunCommands(app);
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
  add(addCheckCalibrationCommand);
  if (const auto code = fathom::parseCommandLine("fathom-topside", app, argc, argv)) return *code;
  return fathom::runTool("fathom-topside", [&]() -> int {
    for (const Command& command : commands)
      if (*command.app) return command.run();
    return fathom::kExitBadInput;
  });
}

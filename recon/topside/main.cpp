#include "recon/topside/commands/commands.hpp"

int main(int argc, char** argv) {
  using namespace fathom::topside;
  fathom::CommandLine app("fathom-topside: from a recorded dive to a model that people explore",
                          "Examples: fathom-topside run missions/reef-grid\n"
                          "          fathom-topside view missions/reef-grid\n"
                          "Each command has a --help of its own.");
  for (const auto add : {addRunCommands, addExportModelCommand, addCheckTilesCommand, addCompareCommand,
                         addViewCommand, addStereoCommand, addSlamCommand, addPosegraphCommand,
                         addCalibrateCommand, addCalibrateColourCommand, addCheckCalibrationCommand})
    add(app);
  return app.run("fathom-topside", argc, argv, fathom::versionLine("fathom-topside"));
}

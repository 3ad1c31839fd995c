#include <malloc.h>

#include "recon/topside/commands/commands.hpp"

namespace {

// Every pair asks for the same images again. glibc gives blocks of their size back to the system, which
// clears them at each use.
void keepFreedImages() {
  constexpr int kLargestBlock_bytes = 32 << 20, kMostKept_bytes = 256 << 20;
  ::mallopt(M_MMAP_THRESHOLD, kLargestBlock_bytes);
  ::mallopt(M_TRIM_THRESHOLD, kMostKept_bytes);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace fathom::topside;
  fathom::CommandLine app("fathom-topside: from a recorded dive to a model that people explore",
                          "Examples: fathom-topside run missions/reef-grid\n"
                          "          fathom-topside view missions/reef-grid\n"
                          "Each command has a --help of its own.");
  keepFreedImages();
  for (const auto add : {addRunCommands, addExportModelCommand, addCheckTilesCommand, addCompareCommand,
                         addViewCommand, addStereoCommand, addSlamCommand, addPosegraphCommand,
                         addCalibrateCommand, addCalibrateColourCommand, addCheckCalibrationCommand})
    add(app);
  return app.run("fathom-topside", argc, argv, fathom::versionLine("fathom-topside"));
}

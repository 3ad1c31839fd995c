// fathom-sim: makes missions with ground truth, plays them to the vehicle's program, and scores estimates
// against the truth.
#include "sim/commands.hpp"

int main(int argc, char** argv) {
  using namespace fathom;
  CommandLine app(
      "Makes missions of a survey AUV with ground truth, plays them to the vehicle's program through real "
      "interfaces, and scores what was estimated from them",
      "Examples: fathom-sim render reef-quick --out missions/reef-quick\n"
      "          fathom-sim score missions/reef-quick\n"
      "Each command has a --help of its own.");
  for (const auto add :
       {sim::addRenderCommand, sim::addControlCommand, sim::addKeysCommand, sim::addScoreCommand,
        sim::addChannelCommand, sim::addCameraCommand, sim::addPictureCommand, sim::addBoardsCommand,
        sim::addHilCommand, sim::addHilCompareCommand, sim::addReplayCommand, sim::addCampaignCommand})
    add(app);
  return app.run("fathom-sim", argc, argv, versionLine("fathom-sim"));
}

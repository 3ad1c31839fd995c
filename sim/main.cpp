// fathom-sim: makes missions with ground truth, plays them to the vehicle's program, and scores estimates
// against the truth. Each command is in a file of its own.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <vector>

#include "realtime/base/command_line.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/version.hpp"
#include "sim/commands.hpp"

namespace {

using namespace fathom;

int run(int argc, char** argv) {
  CLI::App app(
      "Makes missions of a survey AUV with ground truth, plays them to the vehicle's program through real "
      "interfaces, and scores what was estimated from them");
  app.footer(
      "Examples: fathom-sim render reef-quick --out missions/reef-quick\n"
      "          fathom-sim score missions/reef-quick\n"
      "Each command has a --help of its own.");
  app.require_subcommand(1);

  std::vector<sim::Command> commands;
  for (const auto add :
       {sim::addRenderCommand, sim::addControlCommand, sim::addKeysCommand, sim::addScoreCommand,
        sim::addChannelCommand, sim::addCameraCommand, sim::addPictureCommand, sim::addBoardsCommand,
        sim::addHilCommand, sim::addHilCompareCommand, sim::addReplayCommand, sim::addCampaignCommand})
    commands.push_back(add(app));
  app.set_version_flag("--version", versionLine("fathom-sim"));
  if (const auto code = parseCommandLine("fathom-sim", app, argc, argv)) return *code;
  const auto chosen =
      std::ranges::find_if(commands, [](const sim::Command& command) { return command.parser->parsed(); });
  return chosen->run();
}

}  // namespace

int main(int argc, char** argv) {
  return fathom::runTool("fathom-sim", [&] { return run(argc, argv); });
}

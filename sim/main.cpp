// fathom-sim: makes missions with ground truth, plays them to the vehicle's program, and scores what was
// estimated from them. This file parses; each command's file does the work.
#include <CLI/CLI.hpp>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/version.hpp"
#include "sim/boards_command.hpp"
#include "sim/camera_command.hpp"
#include "sim/channel_command.hpp"
#include "sim/hil_command.hpp"
#include "sim/picture_command.hpp"
#include "sim/render_command.hpp"
#include "sim/replay_command.hpp"
#include "sim/score_command.hpp"

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

  sim::RenderOptions render;
  CLI::App* render_command = app.add_subcommand("render", "make a mission folder from a scenario");
  render_command->footer("Example: fathom-sim render reef-grid --out missions/reef-grid --scale 0.5");
  render_command->add_option("scenario", render.scenario, "TOML file, or the name of a shipped scenario")
      ->required();
  render_command->add_option("--out", render.out, "mission folder to make")->required();
  render_command->add_option("--seed", render.seed, "instead of the scenario's own");
  render_command->add_option("--duration", render.duration_s, "cut the survey after this [s]");
  render_command->add_option("--scale", render.scale, "of the images' sides, 0.05 to 1");
  render_command->add_option("--rate", render.rate_hz, "pairs a second, 0.1 to 30");
  render_command->add_option("--threads", render.threads, "0: all")->check(CLI::Range(0, 1024));
  render_command->add_flag("--features", render.features,
                           "write what stereo would match instead of pictures: missions of hours in minutes");
  render_command->add_flag("--force", render.force, "replace a folder that is not empty");

  std::string keys_of;
  CLI::App* keys_command =
      app.add_subcommand("keys", "print every key of a scenario with unit, range, default and meaning");
  keys_command->footer("Example: fathom-sim keys reef-quick");
  keys_command->add_option("scenario", keys_of, "its values (default: the defaults)");

  std::filesystem::path mission;
  bool json = false;
  CLI::App* score_command = app.add_subcommand("score", "compare what was estimated with the truth");
  score_command->footer("Example: fathom-sim score missions/reef-grid");
  score_command->add_option("mission", mission, "mission folder")->required();
  std::vector<std::filesystem::path> surfaces;
  score_command->add_option("--surface", surfaces,
                            "also these PLY meshes in nav, such as levels of the model");
  score_command->add_flag("--json", json, "one JSON object instead of a table");

  CLI::App* channel_command = nullptr;
  const std::function<int()> run_channel = sim::addChannelCommand(app, channel_command);

  CLI::App* camera_command = nullptr;
  const std::function<int()> run_camera = sim::addCameraCommand(app, camera_command);

  CLI::App* picture_command = nullptr;
  const std::function<int()> run_picture = sim::addPictureCommand(app, picture_command);

  CLI::App* boards_command = nullptr;
  const std::function<int()> run_boards = sim::addBoardsCommand(app, boards_command);

  CLI::App* hil_command = nullptr;
  const std::function<int()> run_hil = sim::addHilCommand(app, hil_command);

  CLI::App* hil_compare_command = nullptr;
  const std::function<int()> run_hil_compare = sim::addHilCompareCommand(app, hil_compare_command);

  CLI::App* replay_command = nullptr;
  const std::function<int()> run_replay = sim::addReplayCommand(app, replay_command);

  app.set_version_flag("--version", versionLine("fathom-sim"));
  if (const auto code = parseCommandLine("fathom-sim", app, argc, argv)) return *code;
  if (*render_command) return sim::runRender(render);
  if (*channel_command) return run_channel();
  if (*camera_command) return run_camera();
  if (*picture_command) return run_picture();
  if (*boards_command) return run_boards();
  if (*hil_command) return run_hil();
  if (*hil_compare_command) return run_hil_compare();
  if (*replay_command) return run_replay();
  if (*score_command) return sim::runScore(mission, surfaces, json);
  return sim::runKeys(keys_of);
}

}  // namespace

int main(int argc, char** argv) {
  return fathom::runTool("fathom-sim", [&] { return run(argc, argv); });
}

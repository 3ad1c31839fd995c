#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "realtime/base/progress.hpp"
#include "realtime/base/text.hpp"
#include "sim/boards/board_maker.hpp"
#include "sim/commands.hpp"
#include "sim/mission/control_maker.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"

namespace fathom::sim {
namespace {

struct RenderOptions {
  std::string scenario;              // a path or a shipped name
  std::optional<std::int64_t> seed;  // these replace the scenario's own
  std::optional<double> duration_s;  // longest survey
  std::optional<double> scale;       // of the images' sides
  std::optional<double> rate_hz;     // of pairs
  MissionMakerOptions maker;
};

void requireRange(const char* option, double value, double low, double high) {
  if (value >= low && value <= high) return;
  throw InputError(option, "", formatted("is out of range; give a number from %g to %g", low, high));
}

int render(RenderOptions& options) {
  Scenario scenario = loadScenario(options.scenario);
  if (options.seed) {
    requireRange("--seed", static_cast<double>(*options.seed), 0, 9007199254740992.0);
    scenario.seed = *options.seed;
  }
  if (options.duration_s) {
    requireRange("--duration", *options.duration_s, 1, kLongestSurvey);
    scenario.longest_survey_s = std::min(scenario.longest_survey_s, *options.duration_s);
  }
  if (options.rate_hz) {
    requireRange("--rate", *options.rate_hz, 0.1, 30);
    scenario.sensors.cameras.rate_hz = *options.rate_hz;
  }
  if (options.scale) {
    requireRange("--scale", *options.scale, 0.05, 1);
    scenario.scale = *options.scale;
  }
  rt::ProgressBar bar;
  options.maker.progress = [&bar](std::size_t done, std::size_t total) { bar.show(done, total, "pairs"); };
  const MissionMakerReport report = makeMission(scenario, options.maker);
  std::printf("%s: %zu pairs in %.0f s over %.1f m, altitude %.1f to %.1f m, %zu log entries\n",
              options.maker.out.c_str(), report.pairs, report.survey_s, report.track_m, report.lowest_m,
              report.highest_m, report.samples);
  return kExitSuccess;
}

}  // namespace

void addRenderCommand(CommandLine& app) {
  const auto options = std::make_shared<RenderOptions>();
  CommandLine& command =
      app.command("render", "make a mission folder from a scenario",
                  "Example: fathom-sim render reef-grid --out missions/reef-grid --scale 0.5",
                  [options] { return render(*options); });
  command.add_option("scenario", options->scenario, "TOML file, or the name of a shipped scenario")
      ->required();
  command.add_option("--out", options->maker.out, "mission folder to make")->required();
  command.add_option("--seed", options->seed, "instead of the scenario's own");
  command.add_option("--duration", options->duration_s, "cut the survey after this [s]");
  command.add_option("--scale", options->scale, "of the images' sides, 0.05 to 1");
  command.add_option("--rate", options->rate_hz, "pairs a second, 0.1 to 30");
  command.add_option("--threads", options->maker.threads, "0: all")->check(CLI::Range(0, 1024));
  command.add_flag("--features", options->maker.features,
                   "write simulated stereo features in place of pictures");
  command.add_flag("--force", options->maker.force, "replace a folder that is not empty");
}

void addKeysCommand(CommandLine& app) {
  const auto scenario = std::make_shared<std::string>();
  CommandLine& command = app.command(
      "keys", "print every key of a scenario with unit, range, default and meaning",
      "Example: fathom-sim keys reef-quick", [scenario] {
        std::fputs(scenarioToml(scenario->empty() ? Scenario() : loadScenario(*scenario)).c_str(), stdout);
        return kExitSuccess;
      });
  command.add_option("scenario", *scenario, "its values (default: the defaults)");
}

void addControlCommand(CommandLine& app) {
  struct State {
    std::filesystem::path mission;
    ControlMakerOptions options;
  };
  const auto state = std::make_shared<State>();
  CommandLine& command = app.command(
      "control", "write surveyed control points and their image marks for a simulated dive, with errors",
      "Example: fathom-sim control missions/reef-grid --points 5 --checks 5", [state] {
        const ControlMakerReport report = makeControl(state->mission, state->options);
        std::printf("%s: %d points, %d marks, %d scale bars\n", report.folder.string().c_str(), report.points,
                    report.marks, report.bars);
        return kExitSuccess;
      });
  command.add_option("mission", state->mission, "mission folder with its truth")->required();
  ControlMakerOptions& o = state->options;
  command.add_option("--out", o.out, "folder (MISSION/control)");
  command.shown("--points", o.points, "control points", 0, 1000);
  command.shown("--checks", o.checks, "check points", 0, 1000);
  command.shown("--bars", o.bars, "scale bars", 0, 1000);
  command.shown("--sigma", o.sigma, "of a survey, each axis [m]", 1e-4, 10.0);
  command.shown("--bar-length", o.bar_length, "about [m]", 0.05, 100.0);
  command.shown("--bar-sigma", o.bar_sigma, "of its length [m]", 1e-5, 1.0);
  command.shown("--pixel-sigma", o.pixel_sigma, "of a mark [px]", 0.01, 50.0);
  command.shown("--marks", o.marks, "of a point, at most", 1, 1000);
  command.shown("--seed", o.seed, "of all draws");
}

namespace {

struct BoardsOptions {
  std::string scenario, board = "9x6";
  std::filesystem::path calib;
  std::optional<double> scale;
  BoardMakerOptions maker;
};

void parseBoard(const std::string& size, calibration::Chessboard& board) {
  int used = 0;
  constexpr int kLeast = 3, kMost = 40;  // inner corners along a side
  if (std::sscanf(size.c_str(), "%3dx%3d%n", &board.columns, &board.rows, &used) != 2 ||
      static_cast<std::size_t>(used) != size.size() || std::min(board.columns, board.rows) < kLeast ||
      std::max(board.columns, board.rows) > kMost)
    throw InputError("--board", size, "is not COLUMNSxROWS of inner corners, from 3 to 40 each, such as 9x6");
}

int makeBoardPairs(BoardsOptions& options) {
  Scenario scenario = options.scenario.empty() ? Scenario() : loadScenario(options.scenario);
  if (!options.calib.empty()) scenario.rig = readStereoCalib(options.calib);
  if (options.scale) scenario.scale = *options.scale;
  parseBoard(options.board, options.maker.board);
  rt::ProgressBar bar;
  options.maker.progress = [&bar](std::size_t done, std::size_t total) { bar.show(done, total, "pairs"); };
  makeBoards(scenario, options.maker);
  std::printf("%s: %d pairs of a board of %s inner corners, squares of %g mm\n", options.maker.out.c_str(),
              options.maker.poses.views, options.board.c_str(), 1e3 * options.maker.board.square);
  return kExitSuccess;
}

}  // namespace

void addBoardsCommand(CommandLine& app) {
  const auto options = std::make_shared<BoardsOptions>();
  BoardMakerOptions& maker = options->maker;
  CommandLine& command = app.command(
      "boards", "photograph a chessboard under water, with truth, for calibration",
      "Example: fathom-sim boards --out boards --views 30", [options] { return makeBoardPairs(*options); });
  command.add_option("--out", maker.out, "folder to make: img/ and truth/")->required();
  command.add_option("--scenario", options->scenario,
                     "its rig, water, strobes and sensors are used (default: those of `keys`)");
  command.add_option("--calib", options->calib, "stereo.calib in place of the scenario's rig");
  command.shown("--views", maker.poses.views, "pairs", 1, 1000);
  command.shown("--distance", maker.poses.distance, "mean distance of the board [m]", 0.3, 10.0);
  command.shown("--board", options->board, "inner corners along and across");
  command.shown("--square", maker.board.square, "edge of a square [m]", 0.002, 1.0);
  command.add_option("--scale", options->scale, "of the images' sides")->check(CLI::Range(0.05, 1.0));
  command.shown("--seed", maker.poses.seed, "of poses and noise");
  command.add_option("--threads", maker.threads, "0: all")->check(CLI::Range(0, 1024));
}

}  // namespace fathom::sim

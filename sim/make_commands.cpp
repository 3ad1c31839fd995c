#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "realtime/base/input_error.hpp"
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

Command addRenderCommand(CLI::App& app) {
  const auto options = std::make_shared<RenderOptions>();
  CLI::App* command = app.add_subcommand("render", "make a mission folder from a scenario");
  command->footer("Example: fathom-sim render reef-grid --out missions/reef-grid --scale 0.5");
  command->add_option("scenario", options->scenario, "TOML file, or the name of a shipped scenario")
      ->required();
  command->add_option("--out", options->maker.out, "mission folder to make")->required();
  command->add_option("--seed", options->seed, "instead of the scenario's own");
  command->add_option("--duration", options->duration_s, "cut the survey after this [s]");
  command->add_option("--scale", options->scale, "of the images' sides, 0.05 to 1");
  command->add_option("--rate", options->rate_hz, "pairs a second, 0.1 to 30");
  command->add_option("--threads", options->maker.threads, "0: all")->check(CLI::Range(0, 1024));
  command->add_flag("--features", options->maker.features,
                    "write simulated stereo features in place of pictures");
  command->add_flag("--force", options->maker.force, "replace a folder that is not empty");
  return {command, [options] { return render(*options); }};
}

Command addKeysCommand(CLI::App& app) {
  const auto scenario = std::make_shared<std::string>();
  CLI::App* command =
      app.add_subcommand("keys", "print every key of a scenario with unit, range, default and meaning");
  command->footer("Example: fathom-sim keys reef-quick");
  command->add_option("scenario", *scenario, "its values (default: the defaults)");
  return {command, [scenario] {
            std::fputs(scenarioToml(scenario->empty() ? Scenario() : loadScenario(*scenario)).c_str(),
                       stdout);
            return kExitSuccess;
          }};
}

Command addControlCommand(CLI::App& app) {
  struct State {
    std::filesystem::path mission;
    ControlMakerOptions options;
  };
  const auto state = std::make_shared<State>();
  CLI::App* command = app.add_subcommand(
      "control", "write surveyed control points and their image marks for a simulated dive, with errors");
  command->footer("Example: fathom-sim control missions/reef-grid --points 5 --checks 5");
  command->add_option("mission", state->mission, "mission folder with its truth")->required();
  ControlMakerOptions& o = state->options;
  command->add_option("--out", o.out, "folder (MISSION/control)");
  command->add_option("--points", o.points, "control points")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  command->add_option("--checks", o.checks, "check points")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  command->add_option("--bars", o.bars, "scale bars")->check(CLI::Range(0, 1000))->capture_default_str();
  command->add_option("--sigma", o.sigma, "of a survey, each axis [m]")
      ->check(CLI::Range(1e-4, 10.0))
      ->capture_default_str();
  command->add_option("--bar-length", o.bar_length, "about [m]")
      ->check(CLI::Range(0.05, 100.0))
      ->capture_default_str();
  command->add_option("--bar-sigma", o.bar_sigma, "of its length [m]")
      ->check(CLI::Range(1e-5, 1.0))
      ->capture_default_str();
  command->add_option("--pixel-sigma", o.pixel_sigma, "of a mark [px]")
      ->check(CLI::Range(0.01, 50.0))
      ->capture_default_str();
  command->add_option("--marks", o.marks, "of a point, at most")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--seed", o.seed, "of all draws")->capture_default_str();
  return {command, [state] {
            const ControlMakerReport report = makeControl(state->mission, state->options);
            std::printf("%s: %d points, %d marks, %d scale bars\n", report.folder.string().c_str(),
                        report.points, report.marks, report.bars);
            return kExitSuccess;
          }};
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

Command addBoardsCommand(CLI::App& app) {
  const auto options = std::make_shared<BoardsOptions>();
  BoardMakerOptions& maker = options->maker;
  CLI::App* command =
      app.add_subcommand("boards", "photograph a chessboard under water, with truth, for calibration");
  command->footer("Example: fathom-sim boards --out boards --views 30");
  command->add_option("--out", maker.out, "folder to make: img/ and truth/")->required();
  command->add_option("--scenario", options->scenario,
                      "its rig, water, strobes and sensors are used (default: those of `keys`)");
  command->add_option("--calib", options->calib, "stereo.calib in place of the scenario's rig");
  command->add_option("--views", maker.poses.views, "pairs")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--distance", maker.poses.distance, "mean distance of the board [m]")
      ->check(CLI::Range(0.3, 10.0))
      ->capture_default_str();
  command->add_option("--board", options->board, "inner corners along and across")->capture_default_str();
  command->add_option("--square", maker.board.square, "edge of a square [m]")
      ->check(CLI::Range(0.002, 1.0))
      ->capture_default_str();
  command->add_option("--scale", options->scale, "of the images' sides")->check(CLI::Range(0.05, 1.0));
  command->add_option("--seed", maker.poses.seed, "of poses and noise")->capture_default_str();
  command->add_option("--threads", maker.threads, "0: all")->check(CLI::Range(0, 1024));
  return {command, [options] { return makeBoardPairs(*options); }};
}

}  // namespace fathom::sim

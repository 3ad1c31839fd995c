#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/progress.hpp"
#include "sim/boards/board_maker.hpp"
#include "sim/commands.hpp"
#include "sim/scenario/scenario_file.hpp"

namespace fathom::sim {
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

int run(BoardsOptions& options) {
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
                      "whose rig, water, strobes and sensors (the defaults')");
  command->add_option("--calib", options->calib, "stereo.calib of another rig");
  command->add_option("--views", maker.poses.views, "pairs")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--distance", maker.poses.distance, "of the board, on average [m]")
      ->check(CLI::Range(0.3, 10.0))
      ->capture_default_str();
  command->add_option("--board", options->board, "inner corners along and across")->capture_default_str();
  command->add_option("--square", maker.board.square, "edge of a square [m]")
      ->check(CLI::Range(0.002, 1.0))
      ->capture_default_str();
  command->add_option("--scale", options->scale, "of the images' sides")->check(CLI::Range(0.05, 1.0));
  command->add_option("--seed", maker.poses.seed, "of poses and noise")->capture_default_str();
  command->add_option("--threads", maker.threads, "0: all")->check(CLI::Range(0, 1024));
  return {command, [options] { return run(*options); }};
}

}  // namespace fathom::sim

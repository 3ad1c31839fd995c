#include <cstdio>
#include <memory>

#include "recon/topside/calibration/mission_check.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/report/board_check_report.hpp"

namespace fathom::topside {
namespace {

struct CheckOptions {
  BoardOptions board;
  std::filesystem::path calib, out, corrected;
  std::optional<double> calib_unit;
  std::size_t pairs = 200;
};

void makeFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error || !std::filesystem::is_directory(folder))
    throw InputError("--out", folder.string(), "cannot be made into a folder; name another");
}

int checkOnBoards(const CheckOptions& options) {
  if (options.calib.empty()) throw InputError("--calib", "", "is missing; name the calibration to check");
  Calibration calibration = readCalibration(options.calib, options.calib_unit);
  if (!calibration.about.empty()) std::printf("calibration: %s\n", calibration.about.c_str());
  const calibration::Chessboard board = parseBoard(options.board.size, options.board.square);
  if (!options.out.empty()) makeFolder(options.out);
  BoardImages images = findBoards(options.board.images, board);
  StereoRig& rig = calibration.rig;
  takeSizes(rig, options.calib, {images.left.width, images.left.height},
            {images.right.width, images.right.height});
  for (const auto& [size, camera, side] :
       {std::tuple(images.left, rig.left, "left"), std::tuple(images.right, rig.right, "right")})
    if (size.width != camera.width || size.height != camera.height)
      throw InputError(options.calib.string(), side,
                       "camera is " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                           " where the images are " + std::to_string(size.width) + " x " +
                           std::to_string(size.height));
  // Views of different moments say nothing about the rig; a wrong rig must not make them seem so.
  const std::vector<bool> agrees = alignBoards(rig.left, rig.right, board, images.views);
  for (std::size_t v = images.views.size(); v-- > 0;) {
    if (agrees[v]) continue;
    images.dropped.push_back({images.views[v].name, "left and right disagree about where the board is"});
    images.views.erase(images.views.begin() + static_cast<std::ptrdiff_t>(v));
  }
  const calibration::BoardCheck check = checkBoards(rig, board, images.views);
  const BoardVerdict verdict = judge(check);
  for (const auto& dropped : images.dropped)
    std::printf("left out %s: %s\n", dropped.name.c_str(), dropped.reason.c_str());
  std::printf(
      "%zu boards: RMS %.2f mm; standard deviation x %.2f, y %.2f, z %.2f mm; largest z error %.2f mm\n",
      check.boards.size(), 1e3 * check.rms, 1e3 * std::sqrt(check.covariance(0, 0)),
      1e3 * std::sqrt(check.covariance(1, 1)), 1e3 * std::sqrt(check.covariance(2, 2)), 1e3 * check.max_z);
  for (const std::string& line : verdict.lines) std::printf("%s\n", line.c_str());
  if (!options.out.empty()) {
    writeBoardCheck(options.out, check, verdict, images.dropped);
    std::printf("report: %s\n", (options.out / "board-check.html").c_str());
  }
  return verdict.good ? kExitSuccess : kExitFailedWork;
}

int checkOnMission(const CheckOptions& options) {
  const auto& named = options.board.images.images;
  if (named.size() != 1)
    throw InputError(
        "check-calibration", "",
        "wants one mission folder, or --board, --square and --calib with images of a chessboard");
  if (!options.out.empty()) makeFolder(options.out);
  const MissionCheck check = checkMission({named[0], options.calib, options.pairs, options.calib_unit});
  const MissionVerdict verdict = judge(check);
  std::printf("%zu pairs, %zu matches, %zu places under the DVL, %zu steps\n", check.pairs, check.matches,
              check.range_samples.size(), check.mount.steps);
  for (const auto& line : verdict.lines) std::printf("%s: %s\n", nameOf(line.kind), line.text.c_str());
  if (!options.out.empty()) {
    writeMissionCheck(options.out, check, verdict);
    std::printf("report: %s\n", (options.out / "mission-check.html").c_str());
  }
  if (!options.corrected.empty()) {
    writeStereoCalib(options.corrected, calibration::changed(check.rig, check.epipolar.change));
    std::printf("corrected calibration: %s\n", options.corrected.c_str());
  }
  return verdict.good ? kExitSuccess : kExitFailedWork;
}

}  // namespace

void addCheckCalibrationCommand(CommandLine& app) {
  const auto options = std::make_shared<CheckOptions>();
  CommandLine& command = app.command(
      "check-calibration",
      "whether a rig is still as calibrated: on chessboards, or on a mission's own images",
      "Example: fathom-topside check-calibration missions/reef-grid --out check",
      [options] { return options->board.size.empty() ? checkOnMission(*options) : checkOnBoards(*options); });
  command.add_option("images", options->board.images.images,
                     "with --board: image files or folders; else a mission folder");
  addBoardOptions(command, options->board);
  addCalibOptions(command, options->calib, options->calib_unit, "to check (a mission: its own)");
  command.add_option("--out", options->out, "folder for the report: HTML, JSON, pictures");
  command.add_option("--mended", options->corrected,
                     "of a mission: file for the calibration with the right camera as it stands now");
  command.shown("--pairs", options->pairs, "of a mission that are looked at, in runs spread over it", 1,
                1000000);
}

}  // namespace fathom::topside

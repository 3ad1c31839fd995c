#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <tuple>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/camera.hpp"
#include "recon/import/calibration/calibration.hpp"
#include "recon/topside/calibration/free_matches.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/report/calibration_report.hpp"

namespace fathom::topside {

void addBoardOptions(CLI::App& command, BoardOptions& options) {
  command.add_option("--board", options.size, "inner corners along and across, as 9x6");
  command.add_option("--square", options.square, "edge of a square [m]")->check(CLI::Range(1e-4, 10.0));
  command.add_option("--left", options.images.left_pattern, "shell pattern of the left images, in quotes");
  command.add_option("--right", options.images.right_pattern, "shell pattern of the right images");
  addSampleOptions(command, options.images.left_format, options.images.right_format);
}

void addCalibrateCommand(CommandLine& app) {
  const auto options = std::make_shared<CalibrateOptions>();
  CommandLine& command = app.command(
      "calibrate", "a stereo rig's calibration from photographs of a chessboard, or from a dive's own images",
      "Example: fathom-topside calibrate --board 9x6 --square 0.024 boards/ --out stereo.calib\n"
      "Example: fathom-topside calibrate --self --baseline 0.305 dive/ --out dive/stereo.calib\n"
      "Example: fathom-topside calibrate --board 9x6 --square 0.08 water/ --in-air air.calib --glass 0.01 "
      "--out "
      "stereo.calib",
      [options] {
        const calibration::RigCalibration done = runCalibrate(*options);
        for (const auto& dropped : done.dropped)
          std::printf("dropped %s: %s\n", dropped.name.c_str(), dropped.reason.c_str());
        std::printf("%zu pairs: RMS left %.3f px, right %.3f px, stereo %.3f px; baseline %.2f +- %.2f mm\n",
                    done.views.size(), done.left_rms, done.right_rms, done.stereo_rms,
                    1e3 * done.rig.baseline(), 1e3 * done.sigma.baseline);
        for (const auto& [side, camera, sigma] : {std::tuple("left", &done.rig.left, &done.sigma.left_port),
                                                  {"right", &done.rig.right, &done.sigma.right_port}})
          if (camera->port)
            std::printf("%s port: %.1f +- %.1f mm before the camera, tilted by %.2f deg\n", side,
                        1e3 * camera->port->distance, 1e3 * sigma->distance,
                        radiansToDegrees(std::acos(std::min(1.0, camera->port->normal.z()))));
        std::printf("%s written; report: %s.html, %s.json\n", options->out.c_str(), options->out.c_str(),
                    options->out.c_str());
        return static_cast<int>(kExitSuccess);
      });
  command.add_option("images", options->board.images.images,
                     "image files or folders; left01/right01 or *_LC16/*_RM16 belong together");
  addBoardOptions(command, options->board);
  CLI::Option* self = command.add_flag("--self", options->self, "without a board: images of a scene at rest");
  command
      .add_option("--baseline", options->baseline,
                  "of --self: distance between the cameras [m], which "
                  "images cannot tell")
      ->check(CLI::Range(1e-3, 100.0))
      ->needs(self);
  command
      .add_flag("--free-centre", options->free_centre,
                "of --self: seek the principal points too, which else stay near the images' middles")
      ->needs(self);
  self->needs("--baseline")->excludes("--board")->excludes("--square");
  CLI::Option* air = command
                         .add_option("--in-air", options->air,
                                     "the cameras' calibration in air: boards in water then give their flat "
                                     "ports, written beside --out as .ports")
                         ->excludes(self);
  const auto addGlass = [&](const char* name, double& value, const char* meaning, double low, double high) {
    command.shown(name, value, meaning, low, high)->needs(air);
  };
  addGlass("--glass", options->glass.thickness, "of --in-air: thickness of the ports [m]", 0, 0.2);
  addGlass("--glass-index", options->glass.index, "of --in-air: index of refraction of the ports", 1, 2.5);
  addGlass("--water-index", options->glass.water, "of --in-air: index of refraction of the water", 1, 1.5);
  command.add_option("--out", options->out, "stereo.calib to write; the report goes beside it")->required();
  command.add_flag("--k3", options->config.k3, "estimate the third radial coefficient too")->excludes(self);
}

namespace {

std::string sourceOf(const BoardImageOptions& images) {
  return images.images.empty() ? images.left_pattern : images.images[0].string();
}

StereoRig rigInAir(const std::filesystem::path& file, const BoardImages& images) {
  Calibration air = readCalibration(file, {});
  takeSizes(air.rig, file, {images.left.width, images.left.height},
            {images.right.width, images.right.height});
  if (air.rig.left.port)
    throw InputError(portsBeside(file), "", "these cameras have ports already; give them in air");
  for (const auto& [camera, size, side] :
       {std::tuple(&air.rig.left, images.left, "left"), {&air.rig.right, images.right, "right"}})
    if (camera->width != size.width || camera->height != size.height)
      throw InputError(file, side,
                       formatted("is of images of %d x %d; these are of %d x %d", camera->width,
                                 camera->height, size.width, size.height));
  return air.rig;
}

calibration::RigCalibration calibrateByBoard(const CalibrateOptions& options,
                                             const calibration::Chessboard& board) {
  BoardImages images = findBoards(options.board.images, board);
  const std::string source = sourceOf(options.board.images);
  if (images.views.size() < static_cast<std::size_t>(options.config.min_views) && !images.dropped.empty())
    throw InputError(source, "",
                     std::to_string(images.views.size()) + " pairs show the whole board, at least " +
                         std::to_string(options.config.min_views) + " are needed; " + images.dropped[0].name +
                         ": " + images.dropped[0].reason);
  calibration::RigCalibration done =
      options.air.empty()
          ? calibrateRig(std::move(images.views), board, images.left, images.right, options.config, source)
          : calibratePorts(std::move(images.views), board, rigInAir(options.air, images), options.glass,
                           options.config, source);
  done.dropped.insert(done.dropped.begin(), images.dropped.begin(), images.dropped.end());
  return done;
}

}  // namespace

calibration::RigCalibration runCalibrate(const CalibrateOptions& options) {
  std::optional<calibration::Chessboard> board;
  if (!options.self && options.board.size.empty())
    throw InputError("--board", "", "is missing; give --board and --square, or --self and --baseline");
  if (!options.self) board = parseBoard(options.board.size, options.board.square);
  // Said before the work, not after it.
  std::error_code error;
  if (std::filesystem::is_directory(options.out, error))
    throw InputError("--out", options.out.string(), "is a folder; name a file, such as stereo.calib");
  if (options.out.has_parent_path() && !std::filesystem::is_directory(options.out.parent_path(), error))
    throw InputError("--out", options.out.string(),
                     "is in no folder; make " + options.out.parent_path().string() + " first");
  if (!options.air.empty()) (void)readCalibration(options.air, {});
  constexpr std::size_t kMostPairs = 40;  // of a dive; more tell little that is new
  calibration::SelfCalibrationConfig self;
  if (options.free_centre) self.bundle.prior.centre = calibration::kFreeCentre;
  calibration::RigCalibration done =
      board ? calibrateByBoard(options, *board)
            : calibration::selfCalibrate(findTracks(options.board.images, kMostPairs), options.baseline, self,
                                         sourceOf(options.board.images));
  writeStereoCalib(options.out, done.rig);
  writeCalibrationReport(options.out, done, board);
  return done;
}

}  // namespace fathom::topside

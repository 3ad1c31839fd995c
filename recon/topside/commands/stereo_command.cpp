#include <array>
#include <cstdio>
#include <memory>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/import/images/board_images.hpp"
#include "recon/stereo/dense_stereo.hpp"
#include "recon/stereo/seed_plane.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/report/stereo_output.hpp"
#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {
namespace {

struct StereoOptions {
  std::filesystem::path calib, left, right, out, points, picture, config;
  std::optional<double> altitude, calib_unit;
  std::optional<int> features;
  std::string left_format = "auto", right_format = "auto";
  bool json = false, dense = false;
};

// Said before the work, not after it.
void requireFolder(const char* option, const std::filesystem::path& file) {
  if (file.empty()) return;
  std::error_code error;
  if (std::filesystem::is_directory(file, error))
    throw InputError(option, file.string(), "is a folder; name a file");
  if (file.has_parent_path() && !std::filesystem::is_directory(file.parent_path(), error))
    throw InputError(option, file.string(),
                     "is in no folder; make " + file.parent_path().string() + " first");
}

// The rig; its image sizes from the images where the calibration gives none.
StereoRig readRig(const StereoOptions& options) {
  Calibration calibration = readCalibration(options.calib, options.calib_unit);
  if (!calibration.about.empty()) std::fprintf(stderr, "calibration: %s\n", calibration.about.c_str());
  StereoRig& rig = calibration.rig;
  const auto sizeOf = [](const std::filesystem::path& path) -> std::array<int, 2> {
    const ImageView view = readSamples(path, Samples::kAuto).view;
    return {view.width, view.height};
  };
  if (rig.left.width == 0 || rig.right.width == 0)
    takeSizes(rig, options.calib, sizeOf(options.left), sizeOf(options.right));
  return rig;
}

// The plane of the seafloor where nobody gave an altitude. Throws std::runtime_error when there is none to be
// found.
stereo::SeedPlane findPlane(const StereoRig& rig, const stereo::SparseStereoConfig& config,
                            const LooseImage& left, const LooseImage& right) {
  if (const auto plane = stereo::PlaneScout(rig, config).find(left.monoView(), right.monoView()))
    return *plane;
  throw std::runtime_error(
      "no surface found between " + std::to_string(config.min_range) + " and " +
      std::to_string(config.max_range) +
      " m; give --altitude, and see that the images belong to one another and to the calibration");
}

int runStereo(const StereoOptions& options) {
  requireFolder("--out", options.out);
  requireFolder("--points", options.points);
  requireFolder("--picture", options.picture);
  TopsideConfig config = options.config.empty() ? TopsideConfig{} : readTopsideConfig(options.config);
  if (options.features) config.stereo.max_features = *options.features;
  if (options.dense) config.dense_stereo = true;
  const StereoRig rig = readRig(options);

  PairReport report;
  report.method = "sparse";
  Stopwatch watch;
  const auto lap = [&](const char* stage) { report.stage_ms.emplace_back(stage, 1e3 * watch.lap()); };
  const LooseImage left = readLooseImage(options.left, samplesNamed(options.left_format), rig.left);
  const LooseImage right = readLooseImage(options.right, samplesNamed(options.right_format), rig.right);
  lap("read");
  if (options.altitude) {
    report.plane.distance = *options.altitude;
  } else {
    report.plane = findPlane(rig, config.stereo, left, right);
    report.plane_found = true;
    lap("plane");
  }

  const stereo::StereoResult result = [&] {
    if (config.dense_stereo) {
      report.method = "dense";
      stereo::DenseStereo stereo(rig, config.stereo, config.dense);
      lap("set-up");
      stereo.setStageObserver(lap);
      return stereo.process(left.monoView(), right.monoView(), report.plane);
    }
    stereo::SparseStereo stereo(rig, config.stereo);
    lap("set-up");
    stereo.setStageObserver(lap);
    return stereo.process(left.monoView(), right.monoView(), report.plane);
  }();
  const Mesh mesh = stereo::toMesh(result, left.rgbView());
  lap("mesh");

  if (!options.out.empty()) {
    if (mesh.empty()) throw std::runtime_error("no triangle: too few points for a mesh, nothing written");
    writePly(options.out, mesh,
             {"fathom-topside " FATHOM_VERSION, "left camera frame: x right, y down, z forward [m]"});
  }
  if (!options.points.empty()) writePointsCsv(options.points, result);
  if (!options.picture.empty()) {
    const std::string png = depthPicture(result, left.monoView());
    writeFile(options.picture, png);
  }
  lap("write");
  std::printf("%s\n", (options.json ? pairJson(result, report) : pairText(result, report)).c_str());
  return kExitSuccess;
}

}  // namespace

void addStereoCommand(CommandLine& app) {
  const auto options = std::make_shared<StereoOptions>();
  CommandLine& command = app.command(
      "stereo", "one pair of images to a mesh, points and a picture of depth",
      "Example: fathom-topside stereo --calib stereo.calib left.tif right.tif --out mesh.ply --picture "
      "depth.png",
      [options] { return runStereo(*options); });
  command.add_option("left", options->left, "left image: TIFF, PNG or JPEG")->required();
  command.add_option("right", options->right, "right image")->required();
  addCalibOptions(command, options->calib, options->calib_unit, "stereo calibration of the rig")->required();
  command
      .add_option("--altitude", options->altitude,
                  "of the left camera over the seafloor [m]; without it, it is searched for")
      ->check(CLI::Range(0.1, 100.0));
  command.add_flag("--dense", options->dense, "semi-global matching instead of corners");
  command.add_option("--features", options->features, "corners or dense points wanted (800)")
      ->check(CLI::Range(20, 5000));
  command.add_option("--out", options->out, "mesh to write: PLY in the left camera frame [m]");
  command.add_option("--points", options->points, "points to write: CSV with pixels, metres, sigma_z");
  command.add_option("--picture", options->picture, "PNG to write: depth over the left image");
  command.add_flag("--json", options->json, "print one JSON object: points, rejected by cause, ms by stage");
  command.add_option("--config", options->config, "TOML file; its [stereo] keys are used");
  addSampleOptions(command, options->left_format, options->right_format);
}

}  // namespace fathom::topside

#include "realtime/base/units.hpp"
#include "recon/topside/commands/commands.hpp"

namespace fathom::topside {

CLI::Option* addCalibOptions(CLI::App& command, std::filesystem::path& calib, std::optional<double>& unit,
                             const std::string& about) {
  CLI::Option* option =
      command.add_option("--calib", calib, about + ": stereo.calib, OpenCV, Kalibr, COLMAP or MATLAB (JSON)");
  command
      .add_option_function<std::string>(
          "--calib-unit", [&unit](const std::string& name) { unit = metresIn(name); },
          "of the calibration's lengths, where the file does not say (m)")
      ->check(CLI::IsMember({"m", "cm", "mm"}));
  return option;
}

void addSampleOptions(CLI::App& command, std::string& left, std::string& right) {
  const auto names = CLI::IsMember(sampleNames());
  command
      .add_option("--left-format", left,
                  "of the samples; auto: as the file says, a grey *_LC16 is a Bayer mosaic")
      ->check(names)
      ->capture_default_str();
  command.add_option("--right-format", right, "as --left-format")->check(names)->capture_default_str();
}

void addPoseSettings(CLI::App& command, RunSettings& s) {
  command.add_option("--work", s.places.work, "folder for what the stages hand on (MISSION/topside.work)");
  command.add_option("--config", s.config, "TOML file; keys are in recon/topside/README.md");
  command.add_option("--jobs,--threads", s.jobs, "threads (all cores); the result does not depend on them")
      ->check(CLI::Range(1, 256));
  command.add_option("--features", s.features, "corners or dense points wanted in an image (800)")
      ->check(CLI::Range(20, 5000));
  command.add_flag("--dense", s.dense, "semi-global matching instead of corners");
  command.add_flag("--no-slam", s.no_slam, "dead-reckoned poses: no visual odometry, no loop closures");
  command.add_flag("--no-bundle", s.no_bundle, "localise without bundle adjustment");
  InputOptions& input = s.places.input;
  addCalibOptions(command, input.calib, input.calib_unit, "instead of the folder's own calibration");
  command.add_option("--poses", input.poses,
                     "stereo_pose_est.data: take poses from there instead of localising");
  StereoFileOptions& files = input.files;
  command.add_option("--left", files.left_pattern,
                     "shell pattern of the left images, in quotes (a folder without mission.toml: by names)");
  command.add_option("--right", files.right_pattern, "shell pattern of the right images");
  command.add_option("--pairs", files.pairs, "CSV file instead: columns left, right and, if known, utc");
  command.add_option("--time-pattern", files.time_pattern,
                     "of the left images' names, as 'img_%Y%m%d_%H%M%S_%f' (the usual ones are known)");
  NavFileOptions& nav = input.nav;
  command.add_option(
      "--nav", nav.files,
      "navigation of a folder without any: CSV or NMEA 0183; any of position, depth, attitude, "
      "altitude, velocity");
  command.add_option(
      "--nav-columns", nav.columns,
      "of a CSV, where not known by name: QUANTITY=COLUMN[:UNIT],... as time=t:ms,heading=yaw:rad");
  command.add_option("--nav-crs", nav.crs, "of its eastings and northings, as EPSG:32755");
  command.add_option("--nav-sigma", nav.sigma, "standard deviation of positions that do not say [m] (1)")
      ->check(CLI::Range(0.001, 10000.0));
  command.add_option("--nav-offset", nav.offset, "added to its times to get those of the images [s] (0)");
  command.add_option_function<double>(
      "--declination", [&nav](double degrees) { nav.declination = degreesToRadians(degrees); },
      "of its headings from magnetic north, east positive [deg] (0)");
  command
      .add_option("--mount", input.mount,
                  "how the cameras are turned from looking straight down, top of the image forward: "
                  "ROLL,PITCH,HEADING [deg], and X,Y,Z in the vehicle [m]")
      ->delimiter(',');
  command.add_option(
      "--control", input.control,
      "folder of control points, check points and scale bars (MISSION/control, if it is there)");
  command.add_option("--control-crs", input.control_crs, "of their eastings and northings, as EPSG:32755");
  command.add_option("--colour", input.colour.images,
                     "shell pattern, in quotes, of the images of a colour camera beside the pair, taken with "
                     "its; several, if need be");
  command.add_option("--colour-calib", input.colour.calibs,
                     "for each: calibration of the left camera and this one as a pair");
  command.add_option("--colour-format", input.colour.format, "as --left-format")
      ->check(CLI::IsMember(sampleNames()))
      ->capture_default_str();
  command.add_option("--masks", input.masks,
                     "picture for all images, black where they show the vehicle, or folder of such "
                     "(MISSION/masks, if it is there)");
  command.add_option("--region", input.region,
                     "polygons that the model keeps to, as GeoJSON or what else GDAL reads "
                     "(MISSION/region.geojson, if it is there)");
  addSampleOptions(command, input.left_format, input.right_format);
  command.add_flag("--verify", input.verify, "tell images apart by content, not by size and time");
}

void addRunSettings(CLI::App& command, RunSettings& s) {
  command
      .add_option("mission", s.places.mission,
                  "mission folder, or any folder of stereo images with a calibration")
      ->required();
  command.add_option("--resolution,--voxel", s.resolution, "edge of a voxel [m] (0.033)")
      ->check(CLI::Range(0.004, 2.0));
  command.add_option("--texel", s.texel, "finest texel [m] (a pixel's size on the ground)")
      ->check(CLI::Range(0.0001, 1.0));
  command.add_flag("--no-texture", s.no_texture, "colours by vertex alone");
  command
      .add_option("--textures", s.textures, "in the tiles, JPEG or WebP; or JPEG and BC1 beside it for GPUs")
      ->check(CLI::IsMember({"jpeg", "webp", "ktx2", "dds"}));
  command.add_option("--mode", s.mode, "how images are blended")
      ->check(CLI::IsMember({"bands", "average", "unblended"}));
  addPoseSettings(command, s);
}

TopsideConfig configOf(RunSettings& s) {
  TopsideConfig config = s.config.empty() ? TopsideConfig{} : readTopsideConfig(s.config);
  if (s.resolution) setVoxel(config, *s.resolution);
  if (s.texel) config.model.texel = *s.texel;
  if (s.no_slam) config.slam = false;
  if (s.no_bundle) config.bundle = false;
  if (s.no_texture) config.model.texture = false;
  if (s.dense) config.dense_stereo = true;
  if (s.features) config.stereo.max_features = *s.features;
  if (s.jobs) config.threads = *s.jobs;
  if (s.textures) {
    config.model.picture.format = s.textures == "webp" ? PictureFormat::kWebp : PictureFormat::kJpeg;
    config.model.gpu_texture = s.textures == "ktx2"  ? GpuTexture::kKtx2
                               : s.textures == "dds" ? GpuTexture::kDds
                                                     : GpuTexture::kNone;
  }
  if (s.mode)
    config.model.blend.mode = s.mode == "average"     ? surface::BlendMode::kAverage
                              : s.mode == "unblended" ? surface::BlendMode::kUnblended
                                                      : surface::BlendMode::kBands;
  s.places.input.files.tolerance = config.pairing_tolerance;
  return config;
}

}  // namespace fathom::topside

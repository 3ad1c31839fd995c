#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "realtime/base/command_line.hpp"
#include "recon/calibration/port_calibration.hpp"
#include "recon/calibration/rig_calibration.hpp"
#include "recon/compare/surface_file.hpp"
#include "recon/import/calibration/calibration.hpp"
#include "recon/import/images/board_images.hpp"
#include "recon/topside/pipeline.hpp"

namespace fathom::topside {

// The commands of fathom-topside, each in a file of its own.
void addRunCommands(CommandLine& program);         // run, stage, plan: a dive, one of its stages, their items
void addExportModelCommand(CommandLine& program);  // what a finished run can be handed on as
void addCheckTilesCommand(CommandLine& program);   // whether tiles are whole and join
void addCompareCommand(CommandLine& program);      // a survey beside multibeam or another dive
void addViewCommand(CommandLine& program);         // serves a dive's output until interrupted
void addStereoCommand(CommandLine& program);       // one pair to a mesh, points and a picture
void addSlamCommand(CommandLine& program);         // the poses of a mission and the page about them
void addPosegraphCommand(CommandLine& program);    // optimises a g2o file of 3D poses
void addCalibrateCommand(CommandLine& program);    // a rig, from boards or a dive's images
void addCalibrateColourCommand(CommandLine& program);   // colours, from photographs of a chart
void addCheckCalibrationCommand(CommandLine& program);  // a rig on boards or a mission: 0 good, 1 not

// What can be said about a run on the command line.
struct RunSettings {
  RunPlaces places;
  std::filesystem::path config;
  std::optional<double> resolution, texel;
  std::optional<int> features, jobs;
  bool dense = false, no_slam = false, no_bundle = false, no_texture = false;
  std::optional<std::string> textures, mode;
};

// The options that poses and features depend on; and all, with the mission's folder.
void addPoseSettings(CLI::App& command, RunSettings& settings);
void addRunSettings(CLI::App& command, RunSettings& settings);

// The configuration's file, and over it what the command line says. Throws InputError. Hands the pairing
// tolerance, which a configuration may hold, to the places.
[[nodiscard]] TopsideConfig configOf(RunSettings& settings);

// --calib and --calib-unit, for readCalibration(). Gives the option of --calib.
CLI::Option* addCalibOptions(CLI::App& command, std::filesystem::path& calib, std::optional<double>& unit,
                             const std::string& about);
// --left-format and --right-format, to be read by samplesNamed().
void addSampleOptions(CLI::App& command, std::string& left, std::string& right);

// The options that name a board and its images, of calibrate and check-calibration.
struct BoardOptions {
  std::string size;
  double square = 0;  // [m]
  BoardImageOptions images;
};
void addBoardOptions(CLI::App& command, BoardOptions& options);

struct CalibrateOptions {
  BoardOptions board;
  bool self = false;             // from the images of a dive, without a board ...
  double baseline = 0;           // ... with the distance between the cameras [m] ...
  bool free_centre = false;      // ... and principal points wherever the images say
  std::filesystem::path air;     // the rig's calibration in air: boards in water give its flat ports ...
  calibration::PortGlass glass;  // ... of this glass
  std::filesystem::path out;     // stereo.calib; the report goes to <out>.html and <out>.json
  calibration::RigCalibrationConfig config;
};
// Finds boards, or what the images of a dive show in common, calibrates, writes. Throws InputError.
calibration::RigCalibration runCalibrate(const CalibrateOptions& options);

// Where the nav frame of a mesh is: what stands beside it says so, or the mission folder that it is in.
[[nodiscard]] compare::PlaneFrame frameBeside(const std::filesystem::path& mesh);

}  // namespace fathom::topside

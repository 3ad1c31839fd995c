#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>

#include "recon/calibration/port_calibration.hpp"
#include "recon/calibration/rig_calibration.hpp"
#include "recon/import/images/board_images.hpp"

namespace fathom::topside {

// `fathom-topside calibrate`: adds the sub-command; the function runs it and gives the exit code.
[[nodiscard]] std::function<int()> addCalibrateCommand(CLI::App& app, CLI::App*& command);

// The options that name the board and its images, shared with check-calibration.
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

}  // namespace fathom::topside

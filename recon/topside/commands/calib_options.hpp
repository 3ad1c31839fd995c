#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>

#include "recon/import/calibration/calibration.hpp"

namespace fathom::topside {

// --calib and --calib-unit, for readCalibration(). Gives the option of --calib.
inline CLI::Option* addCalibOptions(CLI::App& command, std::filesystem::path& calib,
                                    std::optional<double>& unit, const std::string& about) {
  CLI::Option* option =
      command.add_option("--calib", calib, about + ": stereo.calib, OpenCV, Kalibr, COLMAP or MATLAB (JSON)");
  command
      .add_option_function<std::string>(
          "--calib-unit", [&unit](const std::string& name) { unit = metresIn(name); },
          "of the calibration's lengths, where the file does not say (m)")
      ->check(CLI::IsMember({"m", "cm", "mm"}));
  return option;
}

}  // namespace fathom::topside

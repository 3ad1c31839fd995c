#pragma once

#include "recon/calibration/rig_calibration.hpp"

namespace fathom::calibration {

// What is known of both ports before boards are seen through them.
struct PortGlass {
  double thickness = 0.01;  // [m]
  double index = 1.49;      // of refraction
  double water = 1.339;     // of the water
};

// Where the flat ports of a rig stand, and how the cameras stand to each other behind them, from boards in
// water; the cameras themselves stay as they were in air. Gauss-Newton on all corners, the boards' poses
// eliminated. Normals are believed to be straight to about 3 degrees. Views whose errors are gross are
// dropped, the worst first, and named. Throws InputError (`source`: file or folder to name) when fewer than
// config.min_views are left, or where they leave a port's distance open.
[[nodiscard]] RigCalibration calibratePorts(std::vector<BoardView> views, const Chessboard& board,
                                            const StereoRig& air, const PortGlass& glass,
                                            const RigCalibrationConfig& config, const std::string& source);

}  // namespace fathom::calibration

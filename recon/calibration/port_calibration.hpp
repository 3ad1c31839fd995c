#pragma once

#include "recon/calibration/rig_calibration.hpp"

namespace fathom::calibration {

// Glass and water of both ports, known in advance.
struct PortGlass {
  double thickness = 0.01;  // [m]
  double index = 1.49;      // of refraction
  double water = 1.339;     // of the water
};

// Estimates normals and distances of a rig's flat ports, and the relative pose of the cameras behind them,
// from boards in water; the cameras' own numbers stay those in air. Gauss-Newton on all corners, the boards'
// poses eliminated, with a prior of straight normals to about 3 degrees. Views with gross errors are dropped,
// the worst first, and named. Throws InputError (`source`: file or folder to name) when fewer than
// config.min_views are left, or where they leave a port's distance open.
[[nodiscard]] RigCalibration calibratePorts(std::vector<BoardView> views, const Chessboard& board,
                                            const StereoRig& air, const PortGlass& glass,
                                            const RigCalibrationConfig& config, const std::string& source);

}  // namespace fathom::calibration

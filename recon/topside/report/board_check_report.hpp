#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "recon/calibration/chessboard.hpp"

namespace fathom::topside {

// How a rig did on boards.
struct BoardVerdict {
  bool good = false;
  std::vector<std::string> lines;  // with the thresholds
};

// Largest corner error in z: the reference's 2 cm at 2 m, in proportion to the square of the range, as
// sigma_z = z^2 sigma_d / (f b) goes; nearer than 1 m as at 1 m. Scale: 0.5 %.
[[nodiscard]] BoardVerdict judge(const calibration::BoardCheck& check);

// <folder>/board-check.html and board-check.json: scatter of the errors in x-z, y-z and x-y with
// three-sigma ellipses, histograms (after Johnson-Roberson et al. 2010, figure 7), a table of the boards.
void writeBoardCheck(const std::filesystem::path& folder, const calibration::BoardCheck& check,
                     const BoardVerdict& verdict, const std::vector<calibration::DroppedView>& dropped);

}  // namespace fathom::topside

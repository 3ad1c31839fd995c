#pragma once

#include <filesystem>
#include <optional>

#include "recon/calibration/rig_calibration.hpp"

namespace fathom::topside {

// <calib>.json and <calib>.html, of photographs of a board or, without one, of a scene: RMS of every view,
// parameters with their standard deviations, coverage of the images by corners, residuals.
void writeCalibrationReport(const std::filesystem::path& calib, const calibration::RigCalibration& done,
                            const std::optional<calibration::Chessboard>& board);

// Part of the image's cells (8 x 6) that hold a corner of any view.
[[nodiscard]] double coverage(const std::vector<calibration::CalibratedView>& views,
                              calibration::Corners calibration::CalibratedView::*corners,
                              const Camera& camera);

}  // namespace fathom::topside

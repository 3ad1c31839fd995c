#pragma once

#include "recon/import/calibration/camera_pair.hpp"

namespace fathom::topside {

// Kalibr's camchain.yaml with two cameras, the first of them left:
//
//   cam0: {camera_model: pinhole, intrinsics: [fu, fv, pu, pv], distortion_model: radtan,
//          distortion_coeffs: [k1, k2, p1, p2], resolution: [width, height]}
//   cam1: {the same, T_cn_cnm1: 4 x 4}      x_cam1 = T_cn_cnm1 x_cam0, metres
//
// distortion_model none has no coefficients. Other models are refused by name. Pixel (0, 0) is the centre of
// the top left pixel. Source: github.com/ethz-asl/kalibr/wiki/yaml-formats.
[[nodiscard]] bool isKalibrCalibration(const CalibrationTree& tree);
[[nodiscard]] CameraPair readKalibrCalibration(const std::filesystem::path& file,
                                               const CalibrationTree& tree);

}  // namespace fathom::topside

#pragma once

#include "recon/import/calibration/camera_pair.hpp"

namespace fathom::topside {

// A stereo calibration as cv::FileStorage writes it (YAML, XML, JSON), or as people write it by OpenCV's
// names.
//
//   K1 D1 K2 D2 R T            x_right = R x_left + T (cv::stereoCalibrate); R may be a rotation vector
//   image_width image_height   or imageSize: [width, height]; for both cameras, or one a camera
//
// Names are taken whatever their case, "_", "-" and "."; for K also M, cameraMatrix, intrinsics ...; for D
// distCoeffs, distortion_coefficients ...; with 1 and 2, left and right, L and R, before or after, or as a
// map around. Where the cameras or R and T are missing, they are taken from the file beside it that OpenCV's
// sample stereo_calib.cpp writes: intrinsics.yml (M1 D1 M2 D2), extrinsics.yml (R T). Translations in metres,
// unless the user says otherwise: no file tells. Pixel (0, 0) is the centre of the top left pixel. Rational
// lenses are fitted (camera_pair.hpp), thin prism, tilted and fisheye ones refused.
[[nodiscard]] bool isOpenCvCalibration(const CalibrationTree& tree);
[[nodiscard]] CameraPair readOpenCvCalibration(const std::filesystem::path& file,
                                               const CalibrationTree& tree);

// extrinsics.yml of intrinsics.yml, and the reverse; "" for other names.
[[nodiscard]] std::filesystem::path openCvPartner(const std::filesystem::path& file);

}  // namespace fathom::topside

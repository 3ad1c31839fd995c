#pragma once

#include "recon/import/calibration/camera_pair.hpp"

namespace fathom::topside {

// MATLAB's stereoParameters as JSON: jsonencode(toStruct(stereoParams)), or of the object. Camera 1 is left.
//
//   CameraParameters1, 2   K, 3 x 3; or IntrinsicMatrix, its transpose (before R2022b)
//                          RadialDistortion [k1 k2 (k3)], TangentialDistortion [p1 p2], as OpenCV's
//                          ImageSize [height width]
//   PoseCamera2            R or the 4 x 4 A, and Translation: x_2 = R x_1 + t (rigidtform3d); or
//                          Rotation and Translation of a rigid3d, as the next
//   RotationOfCamera2      R of rows: x_2' = x_1' R + t' (before R2022b), the transpose of the above
//   TranslationOfCamera2   t
//   WorldUnits             "millimeters", "mm" ...; of each camera, or beside them
//
// Pixel (1, 1) is the centre of the top left pixel in MATLAB: principal points are shifted by one. A skew is
// refused. Source: mathworks.com/help/vision/ref/stereoparameters.html, stereoparameterstoopencv.html.
[[nodiscard]] bool isMatlabCalibration(const CalibrationTree& tree);
[[nodiscard]] CameraPair readMatlabCalibration(const std::filesystem::path& file,
                                               const CalibrationTree& tree);

}  // namespace fathom::topside

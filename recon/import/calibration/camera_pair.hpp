#pragma once

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::topside {

// A lens of OpenCV's rational model, as its sample stereo_calib.cpp fits it,
//   r' = r (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6),
// as one without the denominator: k1, k2 and k3 of the camera are changed to the least squares fit between
// the principal point and the farthest corner of the image; of one without a size, a tenth over twice as
// large as the principal point is far from (0, 0). Gives the largest difference there [px]; infinity for a
// lens that folds within the image.
[[nodiscard]] double fitRationalLens(Camera& camera, const std::array<double, 3>& denominator);

using CalibrationTree = nlohmann::json;

// Where in a file something stands, for error lines.
struct CalibrationPlace {
  std::filesystem::path file;
  std::string key = {};
  [[nodiscard]] CalibrationPlace at(const std::string& below) const {
    return {file, key.empty() ? below : key + "." + below};
  }
  [[noreturn]] void fail(const std::string& fix) const;
};

// What a calibration file of any form says, in the conventions of StereoRig but for the unit of length.
struct CameraPair {
  Camera left, right;              // width 0: the file does not say
  SE3 T_right_left;                // translation in `unit`
  std::optional<double> unit = 1;  // [m]; none: the file does not say
  std::string about;               // the form, the files, which camera is which
};

// The finite numbers of a value in order, row by row: a number, a list of numbers or of lists, OpenCV's
// matrix with its data; none for anything else, for over 64, and for a matrix of other rows and columns.
[[nodiscard]] std::optional<std::vector<double>> numbersOf(const CalibrationTree& value);
// The same; throws InputError where there are not as many.
[[nodiscard]] std::vector<double> numbersOf(const CalibrationTree& value, std::size_t count,
                                            const CalibrationPlace& place);

// From here on, each throws InputError with the place for what cannot be.
// From fx 0 cx, 0 fy cy, 0 0 1 [px], (0, 0) the centre of the top left pixel.
[[nodiscard]] Camera cameraOf(const std::vector<double>& matrix, const CalibrationPlace& place);
// k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]] as OpenCV orders them: 0, 4, 5, 8, 12 or 14 numbers. A
// rational lens (k4 k5 k6) is fitted by one without, fitRationalLens(), after setSize() where there is one,
// and refused when that is over 0.1 px off; so are s1 to ty. Gives how far off [px].
double setDistortion(Camera& camera, const std::vector<double>& numbers, const CalibrationPlace& place);
// Width and height.
void setSize(Camera& camera, const std::vector<double>& numbers, const CalibrationPlace& place);
// From a rotation matrix, row by row, or a rotation vector (axis times angle [rad]); and a translation.
[[nodiscard]] SE3 motionOf(const std::vector<double>& rotation, const CalibrationPlace& rotation_place,
                           const std::vector<double>& translation);
// From w x y z and a translation.
[[nodiscard]] SE3 motionOf(const std::array<double, 4>& quaternion, const Eigen::Vector3d& translation,
                           const CalibrationPlace& place);

}  // namespace fathom::topside

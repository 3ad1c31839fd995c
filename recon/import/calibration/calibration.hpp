#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>

#include "recon/geometry/stereo_rig.hpp"

namespace fathom::topside {

// A stereo calibration that somebody has, in any of the forms that are known.
struct Calibration {
  StereoRig rig;      // width and height are 0 where no file gives them: takeSizes()
  std::string about;  // what was read, for people; empty: a stereo.calib
};

// Reads a stereo calibration, recognised by content: ACFR stereo.calib, OpenCV (YAML, XML, JSON), Kalibr's
// camchain, COLMAP's cameras.txt with rigs.txt or rig_config.json, MATLAB's stereoParameters as JSON. Each
// form has a header with its conventions. A form of two files is read from either, with the other beside it.
// `unit`: of translations [m]; without, what the file says, else metres. Throws InputError, which names the
// file, for one that is none of these, more or less than one pair of cameras, a lens that Camera has not, and
// a baseline of over 10 m: most likely millimetres.
[[nodiscard]] Calibration readCalibration(const std::filesystem::path& path, std::optional<double> unit = {});

// The one calibration in a folder: stereo.calib, else the one among *.calib and what is recognised of
// *.yaml, *.yml, *.xml, *.json, cameras.txt and rigs.txt; other files are passed over. Throws InputError for
// none, and for several, with their names.
[[nodiscard]] std::filesystem::path findCalibration(const std::filesystem::path& folder);

// Gives a rig without sizes those of the images, left and right, {width, height} [px]. Throws InputError
// where these are not known either (0), and for a principal point outside the image: another image size.
void takeSizes(StereoRig& rig, const std::filesystem::path& calib, std::array<int, 2> left,
               std::array<int, 2> right);

// Metres in a unit of length as files and options name it ("mm", "millimeters", "m" ...); none for others.
[[nodiscard]] std::optional<double> metresIn(const std::string& unit);

}  // namespace fathom::topside

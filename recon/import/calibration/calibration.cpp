#include "recon/import/calibration/calibration.hpp"

#include <algorithm>
#include <map>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/camera.hpp"
#include "recon/import/calibration/calibration_tree.hpp"
#include "recon/import/calibration/colmap_calibration.hpp"
#include "recon/import/calibration/kalibr_calibration.hpp"
#include "recon/import/calibration/matlab_calibration.hpp"
#include "recon/import/calibration/opencv_calibration.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

constexpr double kLongestBaseline = 10;  // [m]; a vehicle's cameras are nearer

enum class Form : std::uint8_t { kNone, kStereoCalib, kOpenCv, kKalibr, kColmapText, kColmapRig, kMatlab };

struct Recognised {
  Form form = Form::kNone;
  CalibrationTree tree;
};

// Throws InputError for a file that cannot be read or parsed.
Recognised recognise(const fs::path& path) {
  const std::string text = readCalibrationText(path);
  if (!colmapFileOf(text).empty()) return {Form::kColmapText, {}};
  const std::size_t first = std::min(text.find_first_not_of(" \t\r\n"), text.size());
  const std::size_t end = std::min(text.find_first_of(" \t\r\n", first), text.size());
  if (decimalNumber(std::string_view(text).substr(first, end - first))) return {Form::kStereoCalib, {}};
  CalibrationTree tree = parseCalibrationTree(text, path);
  const Form form = isMatlabCalibration(tree)   ? Form::kMatlab
                    : isKalibrCalibration(tree) ? Form::kKalibr
                    : isColmapRig(tree)         ? Form::kColmapRig
                    : isOpenCvCalibration(tree) ? Form::kOpenCv
                                                : Form::kNone;
  return {form, std::move(tree)};
}

CameraPair readPair(const fs::path& path, const Recognised& file) {
  switch (file.form) {
    case Form::kOpenCv:
      return readOpenCvCalibration(path, file.tree);
    case Form::kKalibr:
      return readKalibrCalibration(path, file.tree);
    case Form::kColmapText:
      return readColmapText(path);
    case Form::kColmapRig:
      return readColmapRig(path, file.tree);
    case Form::kMatlab:
      return readMatlabCalibration(path, file.tree);
    case Form::kStereoCalib:
    case Form::kNone:
      break;
  }
  throw InputError(path.string(), "",
                   "is no stereo calibration that is known: stereo.calib, OpenCV (K1 D1 K2 D2 R T), Kalibr "
                   "camchain, COLMAP cameras.txt, MATLAB stereoParameters");
}

void requirePrincipalPoint(const Camera& camera, const char* side, const fs::path& calib) {
  if (camera.contains({camera.cx, camera.cy})) return;
  throw InputError(calib.string(), side,
                   "the principal point " + decimals(camera.cx, 1) + " " + decimals(camera.cy, 1) +
                       " is outside the image of " + std::to_string(camera.width) + " x " +
                       std::to_string(camera.height) + "; give the calibration of images of this size");
}

// Files of one calibration have the same; "" where it is no calibration.
std::string calibrationOf(const fs::path& file) {
  std::string name = file.filename().string();
  const std::string extension = file.extension().string();
  if (extension == ".calib") return name;
  constexpr std::array kExtensions{".yaml", ".yml", ".xml", ".json"};
  if (std::find(kExtensions.begin(), kExtensions.end(), extension) == kExtensions.end() &&
      name != "cameras.txt" && name != "rigs.txt")
    return "";
  try {
    const Form form = recognise(file).form;
    if (form == Form::kNone || form == Form::kStereoCalib) return "";
    if (form == Form::kColmapText || form == Form::kColmapRig) return "cameras.txt";
    if (form != Form::kOpenCv) return name;
    return std::max(name, openCvPartner(file).filename().string());
  } catch (const InputError&) {
    return "";
  }
}

}  // namespace

Calibration readCalibration(const fs::path& path, std::optional<double> unit) {
  const Recognised file = recognise(path);
  if (file.form == Form::kStereoCalib) {
    if (unit) throw InputError(path.string(), "", "is a stereo.calib, in metres; leave --calib-unit out");
    return {readStereoCalib(path), ""};
  }
  const CameraPair pair = readPair(path, file);
  if (!unit) unit = pair.unit;
  if (!unit)
    throw InputError(path.string(), "", "does not say its unit of length; give --calib-unit mm or m");
  Calibration out{{pair.left, pair.right, {}}, {}};
  out.rig.T_right_left = SE3(pair.T_right_left.rotation(), *unit * pair.T_right_left.translation());
  const Eigen::Vector3d right_in_left = out.rig.T_right_left.inverse().translation();
  const std::string baseline = decimals(out.rig.baseline(), 3) + " m";
  if (!(out.rig.baseline() > 0)) throw InputError(path.string(), "", "the baseline is zero");
  if (!(out.rig.baseline() < kLongestBaseline))
    throw InputError(
        path.string(), "",
        "a baseline of " + baseline + " cannot be; if lengths are in millimetres, give --calib-unit mm");
  if (out.rig.left.width != 0) requirePrincipalPoint(out.rig.left, "left", path);
  if (out.rig.right.width != 0) requirePrincipalPoint(out.rig.right, "right", path);
  out.about = printableText(pair.about) + ", baseline " + baseline;
  const double aside = right_in_left.x(), below = right_in_left.y();
  if (std::abs(below) > std::abs(aside))
    out.about += std::string(", the right camera ") + (below > 0 ? "below" : "above") + " the left one";
  else if (aside < 0)
    out.about += ", the right camera to the left of the left one";
  return out;
}

fs::path findCalibration(const fs::path& folder) {
  if (fs::exists(folder / "stereo.calib")) return folder / "stereo.calib";
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.is_regular_file(error)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::map<std::string, fs::path> found;
  for (const fs::path& file : files)
    if (const std::string calibration = calibrationOf(file); !calibration.empty())
      found.emplace(calibration, file);
  if (found.size() == 1) return found.begin()->second;
  std::string names;
  for (const auto& [calibration, file] : found)
    names += (names.empty() ? "" : ", ") + file.filename().string();
  throw InputError(folder.string(), "stereo.calib",
                   found.empty() ? "no stereo calibration; give one with --calib"
                                 : "several calibrations (" + names + "); name one with --calib");
}

void takeSizes(StereoRig& rig, const fs::path& calib, std::array<int, 2> left, std::array<int, 2> right) {
  for (const auto& [camera, size, side] :
       {std::tuple(&rig.left, left, "left"), {&rig.right, right, "right"}}) {
    if (camera->width != 0) continue;
    if (size[0] == 0)
      throw InputError(calib.string(), side,
                       "gives no image size, and no image does; write image_width and image_height into it");
    camera->width = size[0];
    camera->height = size[1];
    requirePrincipalPoint(*camera, side, calib);
  }
  if (!rig.left.port) readPorts(calib, rig);
}

std::optional<double> metresIn(const std::string& unit) {
  static const std::map<std::string, double> kUnits{{"m", 1},
                                                    {"meter", 1},
                                                    {"meters", 1},
                                                    {"metre", 1},
                                                    {"metres", 1},
                                                    {"cm", 0.01},
                                                    {"centimeter", 0.01},
                                                    {"centimeters", 0.01},
                                                    {"centimetres", 0.01},
                                                    {"mm", 0.001},
                                                    {"millimeter", 0.001},
                                                    {"millimeters", 0.001},
                                                    {"millimetres", 0.001},
                                                    {"in", 0.0254},
                                                    {"inch", 0.0254},
                                                    {"inches", 0.0254}};
  const auto found = kUnits.find(unit);
  if (found == kUnits.end()) return std::nullopt;
  return found->second;
}

}  // namespace fathom::topside

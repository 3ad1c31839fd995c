#include "recon/import/calibration/kalibr_calibration.hpp"

#include <map>
#include <regex>

namespace fathom::topside {
namespace {

using Cameras = std::map<int, std::pair<std::string, const CalibrationTree*>>;

// By number, with their names.
Cameras camerasOf(const CalibrationTree& tree) {
  static const std::regex kName("cam([0-9]{1,4})");
  Cameras cameras;
  if (!tree.is_object()) return cameras;
  for (const auto& item : tree.items()) {
    std::smatch match;
    const std::string& name = item.key();
    if (std::regex_match(name, match, kName) && item.value().is_object() &&
        (item.value().contains("camera_model") || item.value().contains("intrinsics")))
      cameras[std::stoi(match[1])] = {name, &item.value()};
  }
  return cameras;
}

const CalibrationTree& required(const CalibrationTree& map, const char* key, const CalibrationPlace& place) {
  if (!map.contains(key)) place.at(key).fail("is missing");
  return map[key];
}

std::string nameIn(const CalibrationTree& map, const char* key, const CalibrationPlace& place) {
  const CalibrationTree& value = required(map, key, place);
  if (!value.is_string()) place.at(key).fail("is no name");
  return value.get<std::string>();
}

Camera kalibrCamera(const CalibrationTree& map, const CalibrationPlace& place) {
  const std::string model = nameIn(map, "camera_model", place);
  if (model != "pinhole")
    place.at("camera_model").fail("'" + model + "' is not known; calibrate with pinhole and radtan");
  const CalibrationPlace at = place.at("intrinsics");
  const auto f = numbersOf(required(map, "intrinsics", place), 4, at);
  Camera camera = cameraOf({f[0], 0, f[2], 0, f[1], f[3], 0, 0, 1}, at);
  const std::string distortion = nameIn(map, "distortion_model", place);
  if (distortion == "radtan")
    setDistortion(camera,
                  numbersOf(required(map, "distortion_coeffs", place), 4, place.at("distortion_coeffs")),
                  place.at("distortion_coeffs"));
  else if (distortion != "none")
    place.at("distortion_model").fail("'" + distortion + "' is not known; calibrate with pinhole and radtan");
  if (map.contains("resolution"))
    setSize(camera, numbersOf(map["resolution"], 2, place.at("resolution")), place.at("resolution"));
  return camera;
}

}  // namespace

bool isKalibrCalibration(const CalibrationTree& tree) {
  return !camerasOf(tree).empty();
}

CameraPair readKalibrCalibration(const std::filesystem::path& file, const CalibrationTree& tree) {
  const CalibrationPlace place{file};
  const Cameras cameras = camerasOf(tree);
  if (cameras.size() != 2) {
    std::string names;
    for (const auto& [number, camera] : cameras) names += (names.empty() ? "" : ", ") + camera.first;
    place.fail("holds the cameras " + names + "; leave the two of one pair in it, the left one first");
  }
  const auto& [left_name, left] = cameras.begin()->second;
  const auto& [right_name, right] = cameras.rbegin()->second;
  CameraPair pair;
  pair.left = kalibrCamera(*left, place.at(left_name));
  pair.right = kalibrCamera(*right, place.at(right_name));
  const CalibrationPlace at = place.at(right_name).at("T_cn_cnm1");
  const auto m = numbersOf(required(*right, "T_cn_cnm1", place.at(right_name)), 16, at);
  if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1) at.fail("has another last row than 0 0 0 1");
  pair.T_right_left =
      motionOf({m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]}, at, {m[3], m[7], m[11]});
  pair.about = "Kalibr " + file.filename().string() + " (left " + left_name + ", right " + right_name + ")";
  return pair;
}

}  // namespace fathom::topside

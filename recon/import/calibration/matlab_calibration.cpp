#include "recon/import/calibration/matlab_calibration.hpp"

#include "recon/import/calibration/calibration.hpp"

namespace fathom::topside {
namespace {

using Numbers = std::vector<double>;

Numbers transposed(const Numbers& m) {
  return {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]};
}

// The numbers of a key of a map; none where it is absent.
std::optional<Numbers> numbersIn(const CalibrationTree& map, const char* key, std::size_t count,
                                 const CalibrationPlace& place) {
  if (!map.contains(key)) return std::nullopt;
  return numbersOf(map[key], count, place.at(key));
}

Camera matlabCamera(const CalibrationTree& map, const CalibrationPlace& place) {
  auto matrix = numbersIn(map, "K", 9, place);
  if (const auto old = matrix ? std::nullopt : numbersIn(map, "IntrinsicMatrix", 9, place))
    matrix = transposed(*old);
  if (!matrix) place.at("K").fail("is missing, and so is IntrinsicMatrix");
  Camera camera = cameraOf(*matrix, place.at(map.contains("K") ? "K" : "IntrinsicMatrix"));
  camera.cx -= 1;
  camera.cy -= 1;
  const CalibrationPlace at = place.at("RadialDistortion");
  if (!map.contains("RadialDistortion")) at.fail("is missing");
  auto radial = numbersOf(map["RadialDistortion"]);
  if (!radial || (radial->size() != 2 && radial->size() != 3))
    at.fail("holds not two or three finite numbers");
  radial->resize(3);
  const Numbers tangential = numbersIn(map, "TangentialDistortion", 2, place).value_or(Numbers{0, 0});
  setDistortion(camera, {(*radial)[0], (*radial)[1], tangential[0], tangential[1], (*radial)[2]}, at);
  if (map.contains("ImageSize") && !map["ImageSize"].empty()) {
    const Numbers size = numbersOf(map["ImageSize"], 2, place.at("ImageSize"));
    setSize(camera, {size[1], size[0]}, place.at("ImageSize"));
  }
  return camera;
}

SE3 readPose(const CalibrationTree& pose, const CalibrationPlace& place) {
  if (!pose.is_object()) place.fail("is no transformation");
  if (const auto a = numbersIn(pose, "A", 16, place))
    return motionOf({(*a)[0], (*a)[1], (*a)[2], (*a)[4], (*a)[5], (*a)[6], (*a)[8], (*a)[9], (*a)[10]},
                    place.at("A"), {(*a)[3], (*a)[7], (*a)[11]});
  const auto t = numbersIn(pose, "Translation", 3, place);
  if (!t) place.at("Translation").fail("is missing");
  if (const auto r = numbersIn(pose, "R", 9, place)) return motionOf(*r, place.at("R"), *t);
  if (const auto rows = numbersIn(pose, "Rotation", 9, place))
    return motionOf(transposed(*rows), place.at("Rotation"), *t);
  place.fail("has no R");
}

SE3 readMotion(const CalibrationTree& tree, const CalibrationPlace& place) {
  if (tree.contains("PoseCamera2")) return readPose(tree["PoseCamera2"], place.at("PoseCamera2"));
  const auto rows = numbersIn(tree, "RotationOfCamera2", 9, place);
  const auto t = numbersIn(tree, "TranslationOfCamera2", 3, place);
  if (!rows || !t) place.fail("has neither PoseCamera2 nor RotationOfCamera2 with TranslationOfCamera2");
  return motionOf(transposed(*rows), place.at("RotationOfCamera2"), *t);
}

std::optional<double> readUnit(const CalibrationTree& tree, const CalibrationPlace& place) {
  for (const auto& [map, at] :
       {std::pair(&tree, place), {&tree["CameraParameters1"], place.at("CameraParameters1")}}) {
    if (!map->contains("WorldUnits") || !(*map)["WorldUnits"].is_string()) continue;
    const auto name = (*map)["WorldUnits"].get<std::string>();
    if (name.empty()) continue;
    const auto unit = metresIn(name);
    if (!unit) at.at("WorldUnits").fail("'" + name + "' is no unit of length that is known");
    return unit;
  }
  return std::nullopt;
}

}  // namespace

bool isMatlabCalibration(const CalibrationTree& tree) {
  return tree.is_object() && tree.contains("CameraParameters1") && tree.contains("CameraParameters2") &&
         tree["CameraParameters1"].is_object() && tree["CameraParameters2"].is_object();
}

CameraPair readMatlabCalibration(const std::filesystem::path& file, const CalibrationTree& tree) {
  const CalibrationPlace place{file};
  CameraPair pair;
  pair.left = matlabCamera(tree["CameraParameters1"], place.at("CameraParameters1"));
  pair.right = matlabCamera(tree["CameraParameters2"], place.at("CameraParameters2"));
  pair.T_right_left = readMotion(tree, place);
  pair.unit = readUnit(tree, place);
  pair.about = "MATLAB " + file.filename().string() + " (left camera 1, right camera 2)";
  return pair;
}

}  // namespace fathom::topside

#include "recon/import/calibration/colmap_calibration.hpp"

#include <algorithm>
#include <map>
#include <sstream>

#include "recon/import/calibration/calibration_tree.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;
constexpr double kPixelShift = 0.5;  // [px] from COLMAP's origin to the centre of the top left pixel

// A line of data, in words; with its place.
struct Line {
  std::vector<std::string> words;
  CalibrationPlace place;

  [[nodiscard]] double number(std::size_t k) const {
    if (k >= words.size())
      place.fail("ends after " + std::to_string(words.size()) + " values; there must be more");
    const auto number = decimalNumber(words[k]);
    if (!number) place.fail("'" + words[k].substr(0, 40) + "' is no number");
    return *number;
  }
};

std::vector<Line> linesOf(const std::string& text, const fs::path& file,
                          std::size_t most = std::string::npos) {
  std::vector<Line> lines;
  std::istringstream in(text);
  std::string line;
  for (std::size_t number = 1; lines.size() < most && std::getline(in, line); ++number) {
    std::istringstream words(line);
    Line out{{}, {file, "line " + std::to_string(number)}};
    for (std::string word; words >> word;) out.words.push_back(word);
    if (!out.words.empty() && out.words[0][0] != '#') lines.push_back(std::move(out));
  }
  return lines;
}

struct Sensor {
  std::string name;  // its CAMERA_ID, where it has one
  std::optional<SE3> T_camera_rig;
  std::optional<Camera> camera;  // of a rig_config.json that gives it
};
struct Rig {
  std::string name;
  std::vector<Sensor> cameras;  // the reference first
};

using Params = std::vector<double>;

// The intrinsic numbers of a model in the order of FULL_OPENCV.
Params asFullOpenCv(const std::string& model, Params p, const CalibrationPlace& place) {
  static const std::map<std::string, std::size_t> kModels{{"SIMPLE_PINHOLE", 3}, {"PINHOLE", 4},
                                                          {"SIMPLE_RADIAL", 4},  {"RADIAL", 5},
                                                          {"OPENCV", 8},         {"FULL_OPENCV", 12}};
  const auto known = kModels.find(model);
  if (known == kModels.end())
    place.fail("camera model '" + model + "' is not known; reconstruct with PINHOLE, RADIAL or OPENCV");
  if (p.size() != known->second)
    place.fail(model + " has " + std::to_string(known->second) + " parameters, not " +
               std::to_string(p.size()));
  const bool one_focal_length = model.starts_with("SIMPLE") || model == "RADIAL";
  if (one_focal_length) p.insert(p.begin(), p[0]);
  p.resize(12);
  return p;
}

Camera cameraOfModel(const std::string& model, const Params& params, const CalibrationPlace& place) {
  const Params p = asFullOpenCv(model, params, place);
  if (p[9] != 0 || p[10] != 0 || p[11] != 0)
    place.fail("has coefficients k4 to k6, which the camera model has not; reconstruct with OPENCV");
  Camera camera = cameraOf({p[0], 0, p[2], 0, p[1], p[3], 0, 0, 1}, place);
  camera.cx -= kPixelShift;
  camera.cy -= kPixelShift;
  setDistortion(camera, {p.begin() + 4, p.begin() + 9}, place);
  return camera;
}

// The line of a camera in cameras.txt.
Camera cameraIn(const std::vector<Line>& lines, const std::string& id, const fs::path& file) {
  for (const Line& line : lines) {
    if (line.words[0] != id) continue;
    if (line.words.size() < 4) line.place.fail("is no line CAMERA_ID MODEL WIDTH HEIGHT PARAMS");
    Params params;
    for (std::size_t k = 4; k < line.words.size(); ++k) params.push_back(line.number(k));
    Camera camera = cameraOfModel(line.words[1], params, line.place);
    setSize(camera, {line.number(2), line.number(3)}, line.place);
    return camera;
  }
  CalibrationPlace{file}.fail("has no camera " + id + ", which the rig has");
}

Rig rigOf(const Line& line) {
  Rig rig{line.words[0], {}};
  const double sensors = line.number(1);
  std::size_t at = 2;
  const auto take = [&](bool reference) {
    static_cast<void>(line.number(at + 1));  // an identifier, which must be there
    const bool camera = line.words[at] == "CAMERA";
    Sensor sensor{line.words[at + 1], {}, {}};
    at += 2;
    if (reference) {
      sensor.T_camera_rig = SE3();
    } else if (line.number(at++) != 0) {
      const std::array<double, 4> q{line.number(at), line.number(at + 1), line.number(at + 2),
                                    line.number(at + 3)};
      const Eigen::Vector3d t(line.number(at + 4), line.number(at + 5), line.number(at + 6));
      sensor.T_camera_rig = motionOf(q, t, line.place);
      at += 7;
    }
    if (camera) rig.cameras.push_back(std::move(sensor));
  };
  if (!(sensors >= 1 && sensors <= static_cast<double>(line.words.size())))
    line.place.fail("is no line RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID SENSORS");
  for (int k = 0; k < static_cast<int>(sensors); ++k) take(k == 0);
  return rig;
}

std::string idOf(const CalibrationTree& value) {
  return value.is_number_integer() ? value.dump() : std::string();
}

Sensor sensorOf(const CalibrationTree& camera, std::size_t number, const CalibrationPlace& place) {
  Sensor out;
  if (camera.contains("camera_id")) out.name = idOf(camera["camera_id"]);
  if (camera.contains("cam_from_rig_rotation") && camera.contains("cam_from_rig_translation")) {
    const auto q = numbersOf(camera["cam_from_rig_rotation"], 4, place.at("cam_from_rig_rotation"));
    const auto t = numbersOf(camera["cam_from_rig_translation"], 3, place.at("cam_from_rig_translation"));
    out.T_camera_rig = motionOf({q[0], q[1], q[2], q[3]}, Eigen::Vector3d(t.data()), place);
  }
  if (camera.contains("camera_model_name") && camera.contains("camera_params")) {
    const auto params = numbersOf(camera["camera_params"]);
    if (!params || !camera["camera_model_name"].is_string())
      place.at("camera_params").fail("holds something else than finite numbers");
    out.camera = cameraOfModel(camera["camera_model_name"].get<std::string>(), *params, place);
  } else if (out.name.empty()) {
    place.fail("has neither camera_id nor camera_model_name and camera_params");
  }
  if (out.name.empty()) out.name = std::to_string(number + 1);
  return out;
}

Rig rigOf(const CalibrationTree& tree, std::size_t number, const CalibrationPlace& place) {
  Rig rig{std::to_string(number + 1), {}};
  const std::string reference = tree.contains("ref_camera_id") ? idOf(tree["ref_camera_id"]) : "";
  const CalibrationTree& cameras = tree["cameras"];
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    const CalibrationTree& camera = cameras[k];
    const CalibrationPlace at = place.at("camera " + std::to_string(k + 1));
    if (!camera.is_object()) at.fail("is no map");
    Sensor sensor = sensorOf(camera, k, at);
    const bool is_reference = (camera.contains("ref_sensor") && camera["ref_sensor"] == true) ||
                              (!reference.empty() && sensor.name == reference);
    if (is_reference && !sensor.T_camera_rig) sensor.T_camera_rig = SE3();
    rig.cameras.insert(is_reference ? rig.cameras.begin() : rig.cameras.end(), std::move(sensor));
  }
  return rig;
}

// The only rig of two cameras; others have one.
const Rig& onlyPair(const std::vector<Rig>& rigs, const CalibrationPlace& place) {
  std::vector<const Rig*> several;
  std::string held;
  for (const Rig& rig : rigs) {
    if (rig.cameras.size() > 1) several.push_back(&rig);
    held += (held.empty() ? "rig " : "; rig ") + rig.name + " with";
    for (const Sensor& camera : rig.cameras) held += " " + camera.name;
  }
  if (several.size() != 1 || several[0]->cameras.size() != 2)
    place.fail("must hold one rig of two cameras; it holds " + (held.empty() ? "none" : held));
  return *several[0];
}

CameraPair pairOf(const std::vector<Rig>& rigs, const fs::path& rig_file) {
  const CalibrationPlace place{rig_file};
  const Rig& rig = onlyPair(rigs, place);
  const fs::path cameras_file = rig_file.parent_path() / "cameras.txt";
  std::vector<Line> lines;
  if (!rig.cameras[0].camera || !rig.cameras[1].camera)
    lines = linesOf(readCalibrationText(cameras_file), cameras_file);
  CameraPair pair;
  std::array<SE3, 2> T_camera_rig;
  for (const std::size_t k : {0U, 1U}) {
    const Sensor& sensor = rig.cameras[k];
    if (!sensor.T_camera_rig)
      place.fail("gives no pose of camera " + sensor.name + " in its rig; let COLMAP derive it, or write it");
    T_camera_rig[k] = *sensor.T_camera_rig;
    (k == 0 ? pair.left : pair.right) =
        sensor.camera ? *sensor.camera : cameraIn(lines, sensor.name, cameras_file);
  }
  pair.T_right_left = T_camera_rig[1] * T_camera_rig[0].inverse();
  pair.about = "COLMAP " + std::string(lines.empty() ? "" : "cameras.txt and ") +
               rig_file.filename().string() + " (left camera " + rig.cameras[0].name + ", right camera " +
               rig.cameras[1].name + ")";
  return pair;
}

}  // namespace

std::string colmapFileOf(const std::string& text) {
  const std::vector<Line> first = linesOf(text, {}, 1);
  if (first.empty() || first[0].words.size() < 3 || !decimalNumber(first[0].words[0])) return "";
  const std::vector<std::string>& words = first[0].words;
  if (words.size() > 3 && (words[2] == "CAMERA" || words[2] == "IMU") && decimalNumber(words[1]))
    return "rigs.txt";
  const bool model = std::all_of(words[1].begin(), words[1].end(),
                                 [](char c) { return (c >= 'A' && c <= 'Z') || c == '_'; });
  return model && words.size() > 4 && decimalNumber(words[2]) ? "cameras.txt" : "";
}

bool isColmapRig(const CalibrationTree& tree) {
  return tree.is_array() && !tree.empty() && std::all_of(tree.begin(), tree.end(), [](const auto& rig) {
           return rig.is_object() && rig.contains("cameras") && rig["cameras"].is_array();
         });
}

CameraPair readColmapText(const fs::path& file) {
  std::string text = readCalibrationText(file);
  fs::path rigs_file = file;
  if (colmapFileOf(text) == "cameras.txt") {
    rigs_file = file.parent_path() / "rigs.txt";
    const fs::path config = file.parent_path() / "rig_config.json";
    const bool listed = fs::is_regular_file(rigs_file);
    if (!listed && fs::is_regular_file(config))
      return readColmapRig(config, parseCalibrationTree(readCalibrationText(config), config));
    if (listed) text = readCalibrationText(rigs_file);
    if (colmapFileOf(text) == "cameras.txt")  // rigs.txt may be a copy of it
      CalibrationPlace{listed ? rigs_file : file}.fail(
          "has no poses of cameras; put COLMAP's rigs.txt or rig_config.json beside it");
  }
  std::vector<Rig> rigs;
  for (const Line& line : linesOf(text, rigs_file)) rigs.push_back(rigOf(line));
  return pairOf(rigs, rigs_file);
}

CameraPair readColmapRig(const fs::path& file, const CalibrationTree& tree) {
  const CalibrationPlace place{file};
  if (!isColmapRig(tree)) place.fail("is no list of rigs with cameras");
  std::vector<Rig> rigs;
  for (std::size_t k = 0; k < tree.size(); ++k)
    rigs.push_back(rigOf(tree[k], k, place.at("rig " + std::to_string(k + 1))));
  return pairOf(rigs, file);
}

}  // namespace fathom::topside

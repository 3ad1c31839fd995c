#pragma once

#include <filesystem>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <sstream>
#include <string>

#include "recon/geometry/stereo_rig.hpp"

namespace fathom::test {

using Json = nlohmann::ordered_json;

inline cv::Mat matrixOf(const Camera& c) {
  return (cv::Mat_<double>(3, 3) << c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
}
inline cv::Mat distortionOf(const Camera& c) {
  return (cv::Mat_<double>(1, 5) << c.k1, c.k2, c.p1, c.p2, c.k3);
}
inline void writeCameras(cv::FileStorage& out, const StereoRig& rig, const char* matrix) {
  out << matrix + std::string("1") << matrixOf(rig.left) << "D1" << distortionOf(rig.left);
  out << matrix + std::string("2") << matrixOf(rig.right) << "D2" << distortionOf(rig.right);
}
inline void writeMotion(cv::FileStorage& out, const StereoRig& rig, double unit) {
  const Eigen::Matrix3d r = rig.T_right_left.matrix3();
  const Eigen::Vector3d t = rig.T_right_left.translation() / unit;
  cv::Mat rotation(3, 3, CV_64F), translation(3, 1, CV_64F);
  for (int i = 0; i < 9; ++i) rotation.at<double>(i / 3, i % 3) = r(i / 3, i % 3);
  for (int i = 0; i < 3; ++i) translation.at<double>(i) = t(i);
  out << "R" << rotation << "T" << translation;
}

inline std::string exact(const std::vector<double>& numbers, const char* between) {
  std::ostringstream out;
  out << std::setprecision(17);
  for (std::size_t k = 0; k < numbers.size(); ++k) out << (k == 0 ? "" : between) << numbers[k];
  return out.str();
}

inline std::vector<double> poseOf(const SE3& pose) {
  const Eigen::Quaterniond& q = pose.rotation();
  const Eigen::Vector3d& t = pose.translation();
  return {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()};
}

inline Json rowsOf(const Eigen::MatrixXd& m) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    rows.push_back(Json::array());
    for (Eigen::Index j = 0; j < m.cols(); ++j) rows.back().push_back(m(i, j));
  }
  return rows;
}

inline Eigen::Matrix3d matlabMatrix(const Camera& c) {
  Eigen::Matrix3d k;
  k << c.fx, 0, c.cx + 1, 0, c.fy, c.cy + 1, 0, 0, 1;
  return k;
}

inline Json matlabCamera(const Camera& c, const char* unit) {
  return {{"ImageSize", {c.height, c.width}},
          {"RadialDistortion", {c.k1, c.k2, c.k3}},
          {"TangentialDistortion", {c.p1, c.p2}},
          {"WorldUnits", unit},
          {"EstimateSkew", false},
          {"RotationVectors", Json::array()}};
}

inline Json listOf(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

// One plausible rig, and how others write it: each function gives the text of a file, or writes files, from
// the rig and by that program's conventions, none of which the reader's code is used for.
[[nodiscard]] inline StereoRig divingRig() {
  return {{1360, 1024, 1711.82, 1709.31, 692.27, 498.13, 0.135773, 0.734495, 0.0051, -0.0023, -0.31},
          {1280, 1024, 1688.4, 1690.09, 633.9, 520.55, -0.21, 0.052, -0.0007, 0.0013, 0.044},
          SE3::fromEuler(0.031, -0.074, 0.022, {-0.3041, 0.0123, -0.0217})};
}

// cv::FileStorage itself writes these: by extension YAML, XML or JSON. `unit` is that of T [m].
inline void writeOpenCv(const std::filesystem::path& path, const StereoRig& rig, double unit = 1) {
  cv::FileStorage out(path.string(), cv::FileStorage::WRITE);
  writeCameras(out, rig, "K");
  out << "imageSize1" << cv::Size(rig.left.width, rig.left.height);
  out << "imageSize2" << cv::Size(rig.right.width, rig.right.height);
  writeMotion(out, rig, unit);
}

inline void writeOpenCvPair(const std::filesystem::path& intrinsics, const std::filesystem::path& extrinsics,
                            const StereoRig& rig) {
  cv::FileStorage in(intrinsics.string(), cv::FileStorage::WRITE);
  writeCameras(in, rig, "M");
  cv::FileStorage ex(extrinsics.string(), cv::FileStorage::WRITE);
  writeMotion(ex, rig, 1);
  // As the sample goes on.
  for (const char* name : {"R1", "R2", "P1", "P2", "Q"}) ex << name << cv::Mat(cv::Mat::eye(3, 4, CV_64F));
}

[[nodiscard]] inline std::string kalibrText(const StereoRig& rig) {
  std::string out;
  int number = 0;
  for (const Camera* c : {&rig.left, &rig.right}) {
    out += "cam" + std::to_string(number) + ":\n";
    if (number == 1) {
      out += "  T_cn_cnm1:\n";
      const Eigen::Matrix3d r = rig.T_right_left.matrix3();
      for (int i = 0; i < 3; ++i)
        out += "  - [" + exact({r(i, 0), r(i, 1), r(i, 2), rig.T_right_left.translation()(i)}, ", ") + "]\n";
      out += "  - [0.0, 0.0, 0.0, 1.0]\n";
    }
    out += "  cam_overlaps: [" + std::to_string(1 - number++) + "]\n  camera_model: pinhole\n";
    out += "  distortion_coeffs: [" + exact({c->k1, c->k2, c->p1, c->p2}, ", ") + "]\n";
    out += "  distortion_model: radtan\n  intrinsics: [" + exact({c->fx, c->fy, c->cx, c->cy}, ", ") + "]\n";
    out += "  resolution: [" + std::to_string(c->width) + ", " + std::to_string(c->height) + "]\n";
    out += "  rostopic: /stereo/image_raw\n";
  }
  return out;
}

[[nodiscard]] inline std::string colmapCameras(const StereoRig& rig) {
  std::string out = "# Camera list with one line of data per camera:\n# Number of cameras: 3\n";
  for (const auto& [id, c] : {std::pair(3, &rig.right), std::pair(7, &rig.left)})
    out += std::to_string(id) + " FULL_OPENCV " + std::to_string(c->width) + " " + std::to_string(c->height) +
           " " +
           exact({c->fx, c->fy, c->cx + 0.5, c->cy + 0.5, c->k1, c->k2, c->p1, c->p2, c->k3, 0, 0, 0}, " ") +
           "\n";
  return out + "9 OPENCV_FISHEYE 10 10 5 5 5 5 0 0 0 0\n";
}

inline std::string colmapRigs(const StereoRig& rig) {
  return "# Rig calib list with one line of data per calib:\n"
         "#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (...)\n"
         "# Number of rigs: 2\n1 3 CAMERA 7 IMU 1 0 CAMERA 3 1 " +
         exact(poseOf(rig.T_right_left), " ") + "\n2 1 CAMERA 9\n";
}

[[nodiscard]] inline Json colmapRigConfig(const StereoRig& rig) {
  // A rig frame of its own, as old versions allow.
  const SE3 T_left_rig = SE3::fromEuler(0.3, 0.2, 0.1, {1, 2, 3});
  Json cameras = Json::array();
  for (const auto& [id, T] : {std::pair(3, rig.T_right_left * T_left_rig), std::pair(7, T_left_rig)}) {
    const auto p = poseOf(T);
    cameras.push_back({{"camera_id", id},
                       {"image_prefix", "cam" + std::to_string(id) + "/"},
                       {"cam_from_rig_rotation", {p[0], p[1], p[2], p[3]}},
                       {"cam_from_rig_translation", {p[4], p[5], p[6]}}});
  }
  return Json::array({{{"ref_camera_id", 7}, {"cameras", cameras}}});
}

// toStruct() before R2022b, in millimetres; and the object from then on, in metres.
[[nodiscard]] inline Json matlabStruct(const StereoRig& rig) {
  Json out;
  for (const auto& [key, c] :
       {std::pair("CameraParameters1", &rig.left), std::pair("CameraParameters2", &rig.right)}) {
    out[key] = matlabCamera(*c, "millimeters");
    out[key]["IntrinsicMatrix"] = rowsOf(matlabMatrix(*c).transpose());
  }
  out["RotationOfCamera2"] = rowsOf(rig.T_right_left.matrix3().transpose());
  out["TranslationOfCamera2"] = listOf(1000 * rig.T_right_left.translation());
  out["Version"] = {{"Release", "(R2019b)"}};
  return out;
}

[[nodiscard]] inline Json matlabObject(const StereoRig& rig) {
  Json out;
  for (const auto& [key, c] :
       {std::pair("CameraParameters1", &rig.left), std::pair("CameraParameters2", &rig.right)}) {
    out[key] = matlabCamera(*c, "m");
    out[key]["K"] = rowsOf(matlabMatrix(*c));
  }
  const Eigen::Matrix3d r = rig.T_right_left.matrix3();
  out["PoseCamera2"] = {
      {"Dimensionality", 3}, {"R", rowsOf(r)}, {"Translation", listOf(rig.T_right_left.translation())}};
  out["WorldUnits"] = "m";
  return out;
}

}  // namespace fathom::test

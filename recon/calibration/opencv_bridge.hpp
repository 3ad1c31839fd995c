#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::calibration {

// Between OpenCV's types and ours; both call the centre of the top left pixel (0, 0).

[[nodiscard]] inline std::vector<cv::Point2f> toCv(const Corners& corners) {
  std::vector<cv::Point2f> out;
  for (const auto& c : corners) out.emplace_back(static_cast<float>(c.x()), static_cast<float>(c.y()));
  return out;
}

[[nodiscard]] inline std::vector<cv::Point3f> toCv(const std::vector<Eigen::Vector3d>& points) {
  std::vector<cv::Point3f> out;
  for (const auto& p : points)
    out.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()));
  return out;
}

[[nodiscard]] inline cv::Mat matrixOf(const Camera& c) {
  return (cv::Mat_<double>(3, 3) << c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
}

[[nodiscard]] inline cv::Mat distortionOf(const Camera& c) {
  return (cv::Mat_<double>(1, 5) << c.k1, c.k2, c.p1, c.p2, c.k3);
}

[[nodiscard]] inline Camera toCamera(const cv::Mat& k, const cv::Mat& d, int width, int height) {
  const auto distortion = [&](int i) { return i < static_cast<int>(d.total()) ? d.at<double>(i) : 0.0; };
  return {width,
          height,
          k.at<double>(0, 0),
          k.at<double>(1, 1),
          k.at<double>(0, 2),
          k.at<double>(1, 2),
          distortion(0),
          distortion(1),
          distortion(2),
          distortion(3),
          distortion(4)};
}

// From a rotation matrix and a translation, both of doubles.
[[nodiscard]] inline SE3 toSE3(const cv::Mat& rotation, const cv::Mat& translation) {
  Eigen::Matrix3d r;
  for (int i = 0; i < 9; ++i) r(i / 3, i % 3) = rotation.at<double>(i / 3, i % 3);
  return {r, {translation.at<double>(0), translation.at<double>(1), translation.at<double>(2)}};
}

}  // namespace fathom::calibration

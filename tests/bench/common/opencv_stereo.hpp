#pragma once

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// The peer in OpenCV: goodFeaturesToTrack with the Harris measure, calcOpticalFlowPyrLK from left to right
// (from the plane's seeds) and back, the same filters and triangulation. No triangles and no outlier check.
class OpenCvStereo {
 public:
  explicit OpenCvStereo(const StereoRig& rig);
  void process(const cv::Mat& left_image, const cv::Mat& right_image, const SeedPlane& plane, int features);

  // Of the last pair: distorted pixels, and points in the left camera frame [m].
  std::vector<cv::Point2f> left, right;
  std::vector<Eigen::Vector3d> points;

 private:
  StereoRig rig_;
  Eigen::Matrix3d essential_;
};

inline OpenCvStereo::OpenCvStereo(const StereoRig& rig) : rig_(rig) {
  const Eigen::Vector3d& t = rig.T_right_left.translation();
  Eigen::Matrix3d cross;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  essential_ = cross * rig.T_right_left.matrix3();
}

inline void OpenCvStereo::process(const cv::Mat& left_image, const cv::Mat& right_image,
                                  const SeedPlane& plane, int features) {
  constexpr double kQuality = 1e-4, kHarrisK = 0.04;
  constexpr double kSpacing = 1.0 / 3;  // least distance of corners, of their mean spacing, as Fathom keeps
  constexpr int kBlock = 5, kTopLevel = 2, kIterations = 20;
  const cv::Size window(15, 15);
  const cv::TermCriteria stop(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, kIterations, 0.01);
  const SparseStereoConfig limits;
  left.clear(), right.clear(), points.clear();
  std::vector<cv::Point2f> corners;
  const double distance = kSpacing * std::sqrt(static_cast<double>(left_image.size().area()) / features);
  cv::goodFeaturesToTrack(left_image, corners, features, kQuality, distance, cv::noArray(), kBlock, true,
                          kHarrisK);
  std::vector<cv::Point2f> there;
  for (const cv::Point2f& c : corners) {
    const Eigen::Vector3d ray = rig_.left.ray({c.x, c.y});
    const Eigen::Vector2d seed =
        rig_.right.project(rig_.T_right_left * (ray * (plane.distance / plane.normal.dot(ray))));
    there.emplace_back(static_cast<float>(seed.x()), static_cast<float>(seed.y()));
  }
  if (corners.empty()) return;
  std::vector<cv::Mat> left_pyramid, right_pyramid;
  cv::buildOpticalFlowPyramid(left_image, left_pyramid, window, kTopLevel);
  cv::buildOpticalFlowPyramid(right_image, right_pyramid, window, kTopLevel);
  std::vector<std::uint8_t> found, found_back;
  cv::calcOpticalFlowPyrLK(left_pyramid, right_pyramid, corners, there, found, cv::noArray(), window,
                           kTopLevel, stop, cv::OPTFLOW_USE_INITIAL_FLOW);
  std::vector<cv::Point2f> back = corners;
  cv::calcOpticalFlowPyrLK(right_pyramid, left_pyramid, there, back, found_back, cv::noArray(), window,
                           kTopLevel, stop, cv::OPTFLOW_USE_INITIAL_FLOW);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (found[i] == 0 || found_back[i] == 0) continue;
    if (std::hypot(back[i].x - corners[i].x, back[i].y - corners[i].y) > limits.max_left_right_distance)
      continue;
    const Eigen::Vector3d left_ray = rig_.left.ray({corners[i].x, corners[i].y});
    const Eigen::Vector3d right_ray = rig_.right.ray({there[i].x, there[i].y});
    const Eigen::Vector3d line = essential_ * left_ray;
    if (std::abs(line.dot(right_ray)) / line.head<2>().norm() * rig_.right.fx > limits.max_epipolar_distance)
      continue;
    Eigen::Vector3d point;
    double gap = 0;
    if (!triangulateMidpoint(rig_, left_ray, right_ray, point, gap)) continue;
    if (point.z() < limits.min_range || point.z() > limits.max_range) continue;
    left.push_back(corners[i]);
    right.push_back(there[i]);
    points.push_back(point);
  }
}

}  // namespace fathom::stereo

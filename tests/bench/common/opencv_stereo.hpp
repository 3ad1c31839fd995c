#pragma once

#include <opencv2/core.hpp>
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

}  // namespace fathom::stereo

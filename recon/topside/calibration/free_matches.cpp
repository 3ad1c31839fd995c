#include "recon/topside/calibration/free_matches.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "realtime/base/numbers/order_statistics.hpp"

namespace fathom::topside {
namespace {

constexpr int kCorners = 600;             // wanted in an image
constexpr double kQuality = 0.005;        // of the best corner
constexpr double kSpacing = 1.0 / 45;     // between corners, of the image's width
constexpr int kWindow = 21, kLevels = 3;  // reach: about 80 px at full size, 20 px at a quarter
constexpr double kBackAgain = 0.3;        // farther from the start after tracking back: no match [px]

cv::Mat matOf(const ImageView& image) {
  return {image.height, image.width, CV_8UC1, const_cast<void*>(image.data), image.stride};
}

// Tracks points forth and back. `to` holds guesses; good[k] says whether it came back.
std::vector<bool> trackedPoints(const cv::Mat& first, const cv::Mat& second,
                                const std::vector<cv::Point2f>& from, std::vector<cv::Point2f>& to) {
  std::vector<std::uint8_t> forth, back;
  std::vector<float> residual;
  std::vector<cv::Point2f> again = from;
  const cv::TermCriteria enough(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 40, 0.005);
  const cv::Size window(kWindow, kWindow);
  cv::calcOpticalFlowPyrLK(first, second, from, to, forth, residual, window, kLevels, enough,
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  cv::calcOpticalFlowPyrLK(second, first, to, again, back, residual, window, kLevels, enough,
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  std::vector<bool> good(from.size());
  for (std::size_t k = 0; k < from.size(); ++k)
    good[k] = forth[k] != 0 && back[k] != 0 && cv::norm(again[k] - from[k]) < kBackAgain;
  return good;
}

cv::Point2f pointOf(const Eigen::Vector2d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y())};
}

bool nearImage(const Camera& camera, const Eigen::Vector3d& point) {
  constexpr double kWidest = 1.5;  // tangent off the axis; beyond, distortion may fold back
  return point.z() > 0 && point.head<2>().norm() < kWidest * point.z() &&
         camera.contains(camera.project(point), -20.0);
}

}  // namespace

std::vector<RigMatch> matchFreely(const StereoRig& rig, const ImageView& left, const ImageView& right,
                                  const stereo::SeedPlane& plane) {
  const cv::Mat left_image = matOf(left), right_image = matOf(right);
  std::vector<cv::Point2f> corners, from, to;
  constexpr int kBlock = 5;
  cv::goodFeaturesToTrack(left_image, corners, kCorners, kQuality, kSpacing * left.width, cv::noArray(),
                          kBlock, true);
  for (const cv::Point2f& c : corners) {
    const Eigen::Vector3d ray = rig.left.ray({c.x, c.y});
    const double along = plane.normal.dot(ray);
    if (along <= 0) continue;
    const Eigen::Vector3d in_right = rig.T_right_left * (plane.distance / along * ray);
    if (!nearImage(rig.right, in_right)) continue;
    from.push_back(c);
    to.push_back(pointOf(rig.right.project(in_right)));
  }
  std::vector<RigMatch> matches;
  if (from.empty()) return matches;
  const std::vector<bool> good = trackedPoints(left_image, right_image, from, to);
  for (std::size_t k = 0; k < from.size(); ++k)
    if (good[k] && rig.right.contains({to[k].x, to[k].y}))
      matches.push_back({{from[k].x, from[k].y}, {to[k].x, to[k].y}});
  return matches;
}

std::vector<SeenPoint> triangulate(const StereoRig& rig, const std::vector<RigMatch>& matches,
                                   double min_range, double max_range) {
  std::vector<double> errors;
  for (const auto& m : matches) errors.push_back(calibration::epipolarError(rig, m));
  const double middle = median(errors);
  constexpr double kFarOff = 2.0;  // from the median: a wrong match [px]
  std::vector<SeenPoint> out;
  for (std::size_t k = 0; k < matches.size(); ++k) {
    Eigen::Vector3d point;
    double gap = 0;
    if (std::abs(errors[k] - middle) > kFarOff ||
        !triangulatePixels(rig, matches[k].left, matches[k].right, point, gap) ||
        !(point.z() >= min_range && point.z() <= max_range))
      continue;
    out.push_back({matches[k].left, point});
  }
  return out;
}

std::optional<SeenMotion> trackMotion(const Camera& camera, const ImageView& first, const ImageView& next,
                                      const std::vector<SeenPoint>& points, const SE3& T_c1_c0) {
  constexpr std::size_t kFewest = 25;  // points that agree
  std::vector<cv::Point2f> from, to;
  std::vector<Eigen::Vector3d> seen;
  for (const SeenPoint& p : points) {
    const Eigen::Vector3d there = T_c1_c0 * p.point;
    if (!nearImage(camera, there)) continue;
    from.push_back(pointOf(p.left));
    to.push_back(pointOf(camera.project(there)));
    seen.push_back(p.point);
  }
  if (from.size() < kFewest) return std::nullopt;
  const std::vector<bool> good = trackedPoints(matOf(first), matOf(next), from, to);
  std::vector<cv::Point3d> objects;
  std::vector<cv::Point2d> images;  // undistorted, as if of focal length 1
  for (std::size_t k = 0; k < from.size(); ++k) {
    if (!good[k] || !camera.contains({to[k].x, to[k].y})) continue;
    const Eigen::Vector2d n = camera.undistort({to[k].x, to[k].y});
    objects.emplace_back(seen[k].x(), seen[k].y(), seen[k].z());
    images.emplace_back(n.x(), n.y());
  }
  if (objects.size() < kFewest) return std::nullopt;
  const cv::Mat identity = cv::Mat::eye(3, 3, CV_64F);
  cv::Mat rotation, translation, matrix;
  std::vector<int> inliers;
  constexpr double kAgree = 1.5;  // [px]
  constexpr int kTrials = 200;
  constexpr double kConfidence = 0.999;
  cv::setRNGSeed(1);  // the same trials whatever ran before in this thread
  if (!cv::solvePnPRansac(objects, images, identity, cv::noArray(), rotation, translation, false, kTrials,
                          static_cast<float>(kAgree / camera.fx), kConfidence, inliers, cv::SOLVEPNP_EPNP) ||
      inliers.size() < kFewest)
    return std::nullopt;
  std::vector<cv::Point3d> objects_in;
  std::vector<cv::Point2d> images_in;
  SeenMotion out{Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(),
                 inliers.size()};
  for (const int k : inliers) {
    const auto at = static_cast<std::size_t>(k);
    objects_in.push_back(objects[at]);
    images_in.push_back(images[at]);
    out.middle0 +=
        Eigen::Vector3d(objects[at].x, objects[at].y, objects[at].z) / static_cast<double>(inliers.size());
  }
  cv::solvePnPRefineLM(objects_in, images_in, identity, cv::noArray(), rotation, translation);
  cv::Rodrigues(rotation, matrix);
  Eigen::Matrix3d r;
  for (int i = 0; i < 9; ++i) r(i / 3, i % 3) = matrix.at<double>(i / 3, i % 3);
  const SE3 motion(r, {translation.at<double>(0), translation.at<double>(1), translation.at<double>(2)});
  if (!r.allFinite() || !motion.translation().allFinite()) return std::nullopt;
  out.R_c1_c0 = motion.rotation();
  out.middle1 = motion * out.middle0;
  return out;
}

}  // namespace fathom::topside

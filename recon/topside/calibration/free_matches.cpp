#include "recon/topside/calibration/free_matches.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <utility>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/union_find.hpp"
#include "realtime/base/progress.hpp"
#include "recon/import/images/board_images.hpp"

namespace fathom::topside {
namespace {

constexpr int kCorners = 600;  // wanted in an image
// Of the best corner, by Harris' measure, which goes with the contrast's fourth power: ground of a few grey
// levels beside a speck that the strobes saturate.
constexpr double kQuality = 1e-10;
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

namespace {

constexpr int kFeatures = 4000;      // of an image
constexpr double kContrast = 0.004;  // of SIFT: mud has little
constexpr double kShift = -0.25;     // of what OpenCV 4.6 finds, off the true place [px]
constexpr float kRatio = 0.8F;       // to the second best
constexpr std::size_t kAhead = 3;    // pairs

struct Image {
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
};

Image describe(const std::filesystem::path& path, const std::string& format, const Camera& size) {
  const LooseImage read = readLooseImage(path, samplesNamed(format), size);
  const cv::Mat mono(read.height, read.width, CV_8UC1, const_cast<std::uint8_t*>(read.mono.data()));
  Image out;
  cv::SIFT::create(kFeatures, 3, kContrast)
      ->detectAndCompute(mono, cv::noArray(), out.points, out.descriptors);
  return out;
}

// Indices into both.
using Matches = std::vector<std::pair<int, int>>;

using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Map<const Rows> rowsOf(const cv::Mat& descriptors) {
  return {descriptors.ptr<float>(), descriptors.rows, descriptors.cols};
}

Matches matched(const Image& a, const Image& b) {
  Matches out;
  if (a.points.size() < 2 || b.points.size() < 2) return out;
  const auto of_a = rowsOf(a.descriptors), of_b = rowsOf(b.descriptors);
  const Eigen::VectorXf squares_a = of_a.rowwise().squaredNorm(), squares_b = of_b.rowwise().squaredNorm();
  struct Nearest {
    float distance2 = std::numeric_limits<float>::max();
    int other = -1;
  };
  std::vector<Nearest> forth(a.points.size()), second(a.points.size()), back(b.points.size());
  constexpr int kBlock = 256;  // rows at a time
  Rows products;
  for (int first = 0; first < of_a.rows(); first += kBlock) {
    const int count = std::min(kBlock, static_cast<int>(of_a.rows()) - first);
    products.noalias() = of_a.middleRows(first, count) * of_b.transpose();
    for (int i = 0; i < count; ++i) {
      const auto row = static_cast<std::size_t>(first + i);
      for (int j = 0; j < of_b.rows(); ++j) {
        const float d = squares_a(first + i) + squares_b(j) - 2 * products(i, j);
        Nearest& from_b = back[static_cast<std::size_t>(j)];
        if (d < from_b.distance2) from_b = {d, first + i};
        if (d < forth[row].distance2) {
          second[row] = forth[row];
          forth[row] = {d, j};
        } else if (d < second[row].distance2) {
          second[row] = {d, j};
        }
      }
    }
  }
  for (std::size_t i = 0; i < forth.size(); ++i)
    if (forth[i].distance2 < kRatio * kRatio * second[i].distance2 &&
        back[static_cast<std::size_t>(forth[i].other)].other == static_cast<int>(i))
      out.emplace_back(static_cast<int>(i), forth[i].other);
  return out;
}

calibration::ImageSize sizeOf(const std::filesystem::path& path, const std::string& format) {
  const io::ImageFile file = readSamples(path, samplesNamed(format));
  return {file.view.width, file.view.height};
}

Camera ofSize(const calibration::ImageSize& size) {
  Camera out;
  out.width = size.width, out.height = size.height;
  return out;
}

// Both images of every pair, left before right.
std::vector<Image> describeAll(const BoardImageOptions& options, const std::vector<StereoFilePair>& pairs,
                               const Camera& left, const Camera& right) {
  std::vector<Image> images(2 * pairs.size());
  rt::StageProgress progress("features", images.size());
  oneapi::tbb::parallel_for(std::size_t{0}, images.size(), [&](std::size_t k) {
    const StereoFilePair& pair = pairs[k / 2];
    images[k] = k % 2 == 0 ? describe(pair.left, options.left_format, left)
                           : describe(pair.right, options.right_format, right);
    progress.step();
  });
  return images;
}

// Pairs of images that are matched.
std::vector<std::pair<std::size_t, std::size_t>> neighbours(std::size_t pairs) {
  std::vector<std::pair<std::size_t, std::size_t>> out;
  for (std::size_t k = 0; k < pairs; ++k) {
    out.emplace_back(2 * k, 2 * k + 1);
    for (std::size_t next = k + 1; next <= std::min(k + kAhead, pairs - 1); ++next)
      for (const std::size_t side : {0U, 1U}) out.emplace_back(2 * k + side, 2 * next + side);
  }
  return out;
}

}  // namespace

calibration::RigTracks findTracks(const BoardImageOptions& options, std::size_t most) {
  std::vector<StereoFilePair> pairs = findStereoFiles(options).pairs;
  if (pairs.size() > most) {
    const auto first = pairs.begin() + static_cast<std::ptrdiff_t>((pairs.size() - most) / 2);
    pairs = std::vector(first, first + static_cast<std::ptrdiff_t>(most));
  }
  calibration::RigTracks out;
  out.left = sizeOf(pairs[0].left, options.left_format);
  out.right = sizeOf(pairs[0].right, options.right_format);
  for (const StereoFilePair& pair : pairs) out.names.push_back(pair.left.filename().string());
  const std::vector<Image> images = describeAll(options, pairs, ofSize(out.left), ofSize(out.right));

  const auto wanted = neighbours(pairs.size());
  std::vector<Matches> matches(wanted.size());
  {
    rt::StageProgress progress("matches", wanted.size());
    oneapi::tbb::parallel_for(std::size_t{0}, wanted.size(), [&](std::size_t k) {
      matches[k] = matched(images[wanted[k].first], images[wanted[k].second]);
      progress.step();
    });
  }
  // What matches join is one place; two sightings in one image say that a match is wrong.
  std::vector<std::size_t> first(images.size() + 1, 0);
  for (std::size_t i = 0; i < images.size(); ++i) first[i + 1] = first[i] + images[i].points.size();
  UnionFind places(first.back());
  for (std::size_t k = 0; k < wanted.size(); ++k)
    for (const auto& [a, b] : matches[k])
      places.join(static_cast<std::uint32_t>(first[wanted[k].first]) + static_cast<std::uint32_t>(a),
                  static_cast<std::uint32_t>(first[wanted[k].second]) + static_cast<std::uint32_t>(b));
  std::vector<calibration::RigTrack> tracks(first.back());
  std::vector<bool> wrong(first.back(), false);
  for (std::size_t i = 0; i < images.size(); ++i)
    for (std::size_t k = 0; k < images[i].points.size(); ++k) {
      const std::size_t place = places.root(static_cast<std::uint32_t>(first[i] + k));
      auto& sightings = tracks[place].sightings;
      const auto pair = static_cast<std::uint32_t>(i / 2);
      const bool right = i % 2 == 1;
      wrong[place] = wrong[place] ||
                     (!sightings.empty() && sightings.back().pair == pair && sightings.back().right == right);
      const cv::Point2f& at = images[i].points[k].pt;
      sightings.push_back({pair, right, Eigen::Vector2d(at.x + kShift, at.y + kShift)});
    }
  for (std::size_t k = 0; k < tracks.size(); ++k)
    if (!wrong[k] && tracks[k].sightings.size() > 1) out.tracks.push_back(std::move(tracks[k]));
  return out;
}

}  // namespace fathom::topside

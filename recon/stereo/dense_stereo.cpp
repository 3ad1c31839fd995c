#include "recon/stereo/dense_stereo.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "recon/stereo/gray_pyramid.hpp"
#include "recon/stereo/kernels/kernels.hpp"
#include "recon/stereo/local_mesh.hpp"
#include "recon/stereo/match_points.hpp"
#include "recon/stereo/patch_tracker.hpp"

namespace fathom::stereo {
namespace {

// Cost of a pixel of area, against a squared residual [px^2]: on a plane it gives cells of equal size, and
// the noise of semi-global matching, a tenth of a pixel, attracts no cells.
constexpr double kAreaWeight = 0.02;
// Most that a squared residual counts [px^2]: at a step in depth no cell fits, and cutting there would leave
// too few cells for relief.
constexpr double kMostSquare = 0.25;
constexpr int kRootsPerCell = 4;  // wanted cells for each one of the start

bool cheaper(double a, const DisparityCell& ca, double b, const DisparityCell& cb) {
  if (a != b) return a < b;
  return ca.y != cb.y ? ca.y > cb.y : ca.x > cb.x;  // of equals the first in reading order
}

constexpr double kDisparityUnit = 1.0 / 16;  // of StereoSGBM's whole numbers [px]
constexpr int kDisparityStep = 16;           // StereoSGBM searches a multiple of it [px]
constexpr int kMaxDisparities = 512;         // [px of the scaled image]
constexpr double kMinShare = 0.3;            // of a cell's pixels that must have a disparity
constexpr double kMaxRms = 1.0;              // of a cell about its plane [px]: more is a break in depth
// Semi-global matching's sub-pixel interpolation draws towards whole pixels by up to a quarter; Lucas-Kanade
// that goes farther has found something else [px of the scaled image].
constexpr double kMostFromPrediction = 1.0;
constexpr int kDenseLevels = 2;  // of the pyramids: Lucas-Kanade starts within a pixel of the scaled image

void requireDense(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(std::string("dense stereo: ") + what);
}

cv::Mat cameraMatrix(const Camera& c) {
  return (cv::Mat_<double>(3, 3) << c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
}

cv::Mat distortion(const Camera& c) {
  return (cv::Mat_<double>(1, 5) << c.k1, c.k2, c.p1, c.p2, c.k3);
}

}  // namespace

void DisparityCells::integrate(std::span<const float> disparity) {
  const std::size_t columns = index(width_) + 1;
  integral_.assign(columns * (index(height_) + 1), Moments{});
  offset_ = 0;
  double total = 0;
  std::size_t count = 0;
  for (const float d : disparity) {
    if (!std::isfinite(d)) continue;
    total += static_cast<double>(d);
    ++count;
  }
  if (count > 0) offset_ = total / static_cast<double>(count);
  for (int y = 0; y < height_; ++y) {
    Moments row{};
    for (int x = 0; x < width_; ++x) {
      const auto value = disparity[index(y) * index(width_) + index(x)];
      if (std::isfinite(value)) {
        const double u = x - 0.5 * width_, v = y - 0.5 * height_, d = static_cast<double>(value) - offset_;
        const Moments one{1, u, v, u * u, u * v, v * v, d, u * d, v * d, d * d};
        for (std::size_t k = 0; k < kMoments; ++k) row[k] += one[k];
      }
      const Moments& above = integral_[index(y) * columns + index(x) + 1];
      Moments& here = integral_[(index(y) + 1) * columns + index(x) + 1];
      for (std::size_t k = 0; k < kMoments; ++k) here[k] = above[k] + row[k];
    }
  }
}

DisparityCells::Moments DisparityCells::sum(int x, int y, int width, int height) const {
  const std::size_t columns = index(width_) + 1;
  const Moments& a = integral_[index(y) * columns + index(x)];
  const Moments& b = integral_[index(y) * columns + index(x + width)];
  const Moments& c = integral_[index(y + height) * columns + index(x)];
  const Moments& d = integral_[index(y + height) * columns + index(x + width)];
  Moments s;
  for (std::size_t k = 0; k < kMoments; ++k) s[k] = (d[k] - b[k]) - (c[k] - a[k]);
  return s;
}

DisparityCell DisparityCells::fit(int x, int y, int width, int height) const {
  const Moments s = sum(x, y, width, height);
  DisparityCell cell{x, y, width, height, static_cast<int>(std::lround(s[0])), {}, 0, 0};
  if (cell.valid == 0) return cell;
  const double n = s[0], mx = s[1] / n, my = s[2] / n, md = s[6] / n;
  const double xx = s[3] - n * mx * mx, xy = s[4] - n * mx * my, yy = s[5] - n * my * my;
  const double xd = s[7] - n * mx * md, yd = s[8] - n * my * md, dd = s[9] - n * md * md;
  double squares = dd;
  const double determinant = xx * yy - xy * xy;
  constexpr double kMinSpread = 1e-3;  // of a slope in two directions, against pixels in one line
  if (determinant > kMinSpread * xx * yy && determinant > 0) {
    const double a = (xd * yy - yd * xy) / determinant, b = (yd * xx - xd * xy) / determinant;
    squares = dd - a * xd - b * yd;
  }
  cell.centre = {mx + 0.5 * width_, my + 0.5 * height_};
  cell.mean = md + offset_;
  cell.rms = std::sqrt(std::max(squares, 0.0) / n);
  return cell;
}

void DisparityCells::offer(int x, int y, int width, int height) {
  const DisparityCell cell = fit(x, y, width, height);
  if (cell.valid == 0) return;
  if (width < 2 * kMinEdge || height < 2 * kMinEdge) {
    cells_.push_back(cell);
    return;
  }
  heap_.push_back({cell.valid * (std::min(cell.rms * cell.rms, kMostSquare) + kAreaWeight), cell});
  std::push_heap(heap_.begin(), heap_.end(), [](const Candidate& a, const Candidate& b) {
    return cheaper(a.cost, a.cell, b.cost, b.cell);
  });
}

void DisparityCells::cutWorst() {
  std::pop_heap(heap_.begin(), heap_.end(), [](const Candidate& a, const Candidate& b) {
    return cheaper(a.cost, a.cell, b.cost, b.cell);
  });
  const DisparityCell cell = heap_.back().cell;
  heap_.pop_back();
  const int left = cell.width / 2, upper = cell.height / 2;
  offer(cell.x, cell.y, left, upper);
  offer(cell.x + left, cell.y, cell.width - left, upper);
  offer(cell.x, cell.y + upper, left, cell.height - upper);
  offer(cell.x + left, cell.y + upper, cell.width - left, cell.height - upper);
}

const std::vector<DisparityCell>& DisparityCells::simplify(std::span<const float> disparity, int width,
                                                           int height, int wanted) {
  cells_.clear();
  heap_.clear();
  width_ = width;
  height_ = height;
  if (width < 1 || height < 1 || wanted < 1 || disparity.size() != index(width) * index(height))
    return cells_;
  integrate(disparity);
  const double area = static_cast<double>(width) * height;
  const int edge = std::max(2 * kMinEdge, static_cast<int>(std::sqrt(area * kRootsPerCell / wanted)));
  for (int y = 0; y < height; y += edge)
    for (int x = 0; x < width; x += edge) offer(x, y, std::min(edge, width - x), std::min(edge, height - y));
  constexpr std::size_t kGain = 3;  // cells more by one cut
  while (!heap_.empty() && heap_.size() + cells_.size() + kGain <= index(wanted)) cutWorst();
  for (const Candidate& c : heap_) cells_.push_back(c.cell);
  std::sort(cells_.begin(), cells_.end(), [](const DisparityCell& a, const DisparityCell& b) {
    return a.y != b.y ? a.y < b.y : a.x < b.x;
  });
  return cells_;
}

struct DenseStereo::Impl {
  Impl(const StereoRig& r, const SparseStereoConfig& l, const DenseStereoConfig& c);

  void ended(const char* stage) const {
    if (observer) observer(stage);
  }
  cv::Mat rectified(const ImageView& image, const cv::Mat& map1, const cv::Mat& map2) const;
  void match(const cv::Mat& left, const cv::Mat& right, const SeedPlane& plane);
  void addPoint(const DisparityCell& cell);
  void confirm(const Eigen::Vector3d& guess);

  StereoRig rig;
  SparseStereoConfig limits;
  DenseStereoConfig config;
  cv::Size size;  // of the rectified images [px]
  cv::Mat left_map1, left_map2, right_map1, right_map2;
  Eigen::Matrix3d left_from_rectified;  // rotation
  double focal = 0, cx = 0, cy = 0;     // of the rectified left camera [px]
  double shift = 0;                     // of the principal points, left minus right [px]
  double focal_baseline = 0;            // (disparity - shift) times depth [px m]
  cv::Ptr<cv::StereoSGBM> matcher;
  std::vector<float> disparity;  // [px], NaN: none
  DisparityCells cells;
  GrayPyramid left_pyramid, right_pyramid;
  PatchTracker tracker;
  MatchPoints found;
  LocalMesh mesh;
  StereoResult result;
  std::function<void(const char* stage)> observer;
};

DenseStereo::Impl::Impl(const StereoRig& r, const SparseStereoConfig& l, const DenseStereoConfig& c)
    : rig(r),
      limits(l),
      config(c),
      left_pyramid(r.left.width, r.left.height, kDenseLevels, fastestKernels()),
      right_pyramid(r.right.width, r.right.height, kDenseLevels, fastestKernels()),
      tracker(l.window, fastestKernels()),
      found(r, static_cast<std::size_t>(l.max_features)),
      mesh(static_cast<std::size_t>(l.max_features)) {
  const StereoRig scaled = rig.scaled(config.scale);
  size = {scaled.left.width, scaled.left.height};
  cv::Mat rotation, translation, r1, r2, p1, p2, q;
  cv::eigen2cv(Eigen::Matrix3d(rig.T_right_left.matrix3()), rotation);
  cv::eigen2cv(Eigen::Vector3d(rig.T_right_left.translation()), translation);
  cv::stereoRectify(cameraMatrix(scaled.left), distortion(scaled.left), cameraMatrix(scaled.right),
                    distortion(scaled.right), size, rotation, translation, r1, r2, p1, p2, q,
                    cv::CALIB_ZERO_DISPARITY, -1, size);
  focal_baseline = -p2.at<double>(0, 3);
  requireDense(std::abs(p2.at<double>(1, 3)) < 1e-9 && focal_baseline > 0,
               "the right camera must be to the right of the left one");
  cv::initUndistortRectifyMap(cameraMatrix(scaled.left), distortion(scaled.left), r1, p1, size, CV_16SC2,
                              left_map1, left_map2);
  cv::initUndistortRectifyMap(cameraMatrix(scaled.right), distortion(scaled.right), r2, p2, size, CV_16SC2,
                              right_map1, right_map2);
  Eigen::Matrix3d rectified_from_left;
  cv::cv2eigen(r1, rectified_from_left);
  left_from_rectified = rectified_from_left.transpose();
  focal = p1.at<double>(0, 0);
  cx = p1.at<double>(0, 2);
  cy = p1.at<double>(1, 2);
  shift = cx - p2.at<double>(0, 2);
  const int area = config.block * config.block;
  // Penalties as the authors of the implementation advise: 8 and 32 times the window's area.
  matcher = cv::StereoSGBM::create(0, kDisparityStep, config.block, 8 * area, 32 * area, 1, 31, 5, 200, 2,
                                   cv::StereoSGBM::MODE_SGBM);
}

cv::Mat DenseStereo::Impl::rectified(const ImageView& image, const cv::Mat& map1, const cv::Mat& map2) const {
  const cv::Mat full(image.height, image.width, CV_8UC1, const_cast<void*>(image.data), image.stride);
  cv::Mat scaled, out;
  cv::resize(full, scaled, size, 0, 0, cv::INTER_AREA);
  cv::remap(scaled, out, map1, map2, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
  return out;
}

void DenseStereo::Impl::match(const cv::Mat& left, const cv::Mat& right, const SeedPlane& plane) {
  // The disparities of the seed plane over the image, and the search radius to each side.
  constexpr int kNodes = 9;  // a side
  double least = INFINITY, most = -INFINITY;
  const double nearest = focal_baseline / limits.min_range, farthest = focal_baseline / limits.max_range;
  for (int j = 0; j < kNodes; ++j) {
    for (int i = 0; i < kNodes; ++i) {
      const Eigen::Vector3d ray((i * (size.width - 1.0) / (kNodes - 1) - cx) / focal,
                                (j * (size.height - 1.0) / (kNodes - 1) - cy) / focal, 1);
      const double inverse_depth = plane.normal.dot(left_from_rectified * ray) / plane.distance;
      const double d = std::clamp(focal_baseline * inverse_depth, farthest, nearest) + shift;
      least = std::min(least, d);
      most = std::max(most, d);
    }
  }
  const double radius = limits.search_radius * config.scale;
  const int first = static_cast<int>(std::floor(std::max(least - radius, farthest + shift)));
  const double span = std::min(most + radius, nearest + shift) - first;
  const int count = std::clamp(static_cast<int>(std::ceil(span / kDisparityStep)) * kDisparityStep,
                               kDisparityStep, kMaxDisparities);
  matcher->setMinDisparity(first);
  matcher->setNumDisparities(count);
  cv::Mat sixteenths;
  matcher->compute(left, right, sixteenths);
  disparity.assign(static_cast<std::size_t>(size.area()), NAN);
  for (int y = 0; y < size.height; ++y) {
    const auto* row = sixteenths.ptr<std::int16_t>(y);
    float* out = disparity.data() + static_cast<std::ptrdiff_t>(y) * size.width;
    for (int x = 0; x < size.width; ++x) {
      const double d = row[x] * kDisparityUnit;
      if (d >= first) out[x] = static_cast<float>(d);
    }
  }
}

void DenseStereo::Impl::addPoint(const DisparityCell& cell) {
  if (cell.valid < kMinShare * cell.width * cell.height) {
    ++result.rejected.no_track;
    return;
  }
  if (cell.rms > kMaxRms) {
    ++result.rejected.outlier;
    return;
  }
  const double depth = focal_baseline / (cell.mean - shift);  // along the rectified axis [m]
  const Eigen::Vector3d point =
      left_from_rectified *
      Eigen::Vector3d((cell.centre.x() - cx) / focal, (cell.centre.y() - cy) / focal, 1) * depth;
  if (!(cell.mean > shift) || !(point.z() >= limits.min_range) || !(point.z() <= limits.max_range)) {
    ++result.rejected.range;
    return;
  }
  confirm(point);
}

// Lucas-Kanade at the full resolution from where semi-global matching leads, as SparseStereo does at corners.
// Without its word there is no point: where the ground has no texture, semi-global matching carries on the
// nearest surface.
void DenseStereo::Impl::confirm(const Eigen::Vector3d& guess) {
  const Eigen::Vector2d left = rig.left.project(guess).array().round();
  if (!rig.left.contains(left)) {
    ++result.rejected.no_track;
    return;
  }
  const Eigen::Vector3d left_ray = rig.left.ray(left);
  const Eigen::Vector2d predicted = rig.right.project(rig.T_right_left * (left_ray * guess.z()));
  const PatchMatch match = tracker.track(left_pyramid, left, right_pyramid, std::span(&predicted, 1));
  if (!match.found || match.correlation < limits.min_correlation ||
      (match.position - predicted).norm() > kMostFromPrediction / config.scale) {
    ++result.rejected.no_track;
    return;
  }
  if (!found.showsGround(limits, left, match.position, result)) return;
  MatchPoints::Rays rays;
  if (found.nearEpipolarLine(limits, left, left_ray, match.position, rays, result))
    found.add(limits, left, match.position, rays, match.covariance, result);
}

DenseStereo::DenseStereo(const StereoRig& rig, const SparseStereoConfig& limits,
                         const DenseStereoConfig& config) {
  requireDense(config.scale >= 0.1 && config.scale <= 1, "scale must be 0.1 to 1");
  requireDense(config.block >= 1 && config.block <= 21 && config.block % 2 == 1,
               "block must be odd, 1 to 21 px");
  requireDense(rig.left.width == rig.right.width && rig.left.height == rig.right.height,
               "both images must be of the same size");
  requireDense(rig.left.width * config.scale >= 2 * DisparityCells::kMinEdge, "the images are too small");
  requireDense(rig.left.fx > 0 && rig.right.fx > 0 && rig.baseline() > 0,
               "the rig has no focal length or no baseline");
  requireDense(limits.window >= PatchTracker::kMinWindow && limits.window <= PatchTracker::kMaxWindow &&
                   limits.window % 2 == 1,
               "window must be odd, 7 to 31 px");
  requireDense(limits.max_features >= 1, "max_features must be at least 1");
  impl_ = std::make_unique<Impl>(rig, limits, config);
}

DenseStereo::~DenseStereo() = default;

void DenseStereo::setStageObserver(std::function<void(const char* stage)> observer) {
  impl_->observer = std::move(observer);
}

const StereoResult& DenseStereo::process(const ImageView& left, const ImageView& right,
                                         const SeedPlane& plane) {
  Impl& m = *impl_;
  if (!m.found.begin(left, right, plane, m.result)) return m.result;
  const cv::Mat left_image = m.rectified(left, m.left_map1, m.left_map2);
  const cv::Mat right_image = m.rectified(right, m.right_map1, m.right_map2);
  m.left_pyramid.build(left);
  m.right_pyramid.build(right);
  m.ended("rectify");
  m.match(left_image, right_image, plane);
  m.ended("matching");
  const auto& cells = m.cells.simplify(m.disparity, m.size.width, m.size.height, m.limits.max_features);
  m.result.corners = static_cast<std::uint32_t>(cells.size());
  for (const DisparityCell& cell : cells) m.addPoint(cell);
  m.ended("cells");
  m.found.widen(m.result);
  m.mesh.dropOutliers(m.limits, m.result);
  m.ended("outliers");
  m.mesh.triangulate(m.limits, m.result, left.mask);
  m.ended("triangles");
  return m.result;
}

}  // namespace fathom::stereo

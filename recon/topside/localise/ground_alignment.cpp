#include "recon/topside/localise/ground_alignment.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <set>

#include "recon/geometry/se3.hpp"

namespace fathom::topside {
namespace {

using closure::Refusal;

constexpr int kWidest = 700;                            // of the images that are compared [px]
constexpr double kCells = 160;                          // of a picture of the ground, by the plane's distance
constexpr double kTurnStep = 1.0 / 12;                  // of headings that are tried [rad]
constexpr int kTurns = 13, kTurnsReckoned = 3;          // tried about none; about one that is known
constexpr double kLeastOverlap = 0.2;                   // of the smaller picture
constexpr double kFarthestGround = 3.0;                 // of the plane's distance
constexpr int kTrackerWindow = 25, kTrackerLevels = 3;  // of the tracker [px]
constexpr double kMostReturnError = 0.7;                // [px]
constexpr double kAgree = 1.5;                          // with the pose [px]
constexpr int kFewestAgreeing = 40;                     // points that agree
constexpr double kLeastShare = 0.6;                     // of those that were tracked
constexpr double kLeastCoverage = 0.4;
constexpr double kScale = 4.0;       // of standard deviations: neighbours share pixels, and the plane is none
constexpr int kGroundCorners = 800;  // of an image
constexpr double kCornerQuality = 0.005, kCornerSpacing = 8;  // of the best one; between them [px]
constexpr double kNearFeature = 10,
                 kPlaneWeight = 1e-3;  // how far a feature's height tells [px]; the plane's own
constexpr int kImageCellsAcross = 8, kImageCellsDown = 6;

// A point of the ground that one frame shows.
struct GroundPoint {
  Eigen::Vector2d pixel;  // of the small image
  Eigen::Vector3d point;  // camera frame [m]
};

struct Prepared {
  cv::Mat even, grey;
  Camera camera;
  GroundPlane plane;
  std::vector<GroundPoint> points;
};

// Corners of the even image; on the plane, bent to the features about them.
std::vector<GroundPoint> pointsOf(const Prepared& frame, const closure::FrameFeatures& features,
                                  double scale) {
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(frame.grey, corners, kGroundCorners, kCornerQuality, kCornerSpacing);
  std::vector<GroundPoint> out;
  const Eigen::Vector2d half(0.5, 0.5);  // centres of pixels
  for (const cv::Point2f& c : corners) {
    const Eigen::Vector2d pixel(static_cast<double>(c.x), static_cast<double>(c.y));
    double weights = kPlaneWeight, off = 0;
    for (const closure::Feature& f : features.features) {
      const Eigen::Vector2d there = (f.left.cast<double>() + half) * scale - half;
      const double weight = 1 / (kNearFeature * kNearFeature + (there - pixel).squaredNorm());
      weights += weight;
      off += weight * (frame.plane.normal.dot(f.point.cast<double>()) - frame.plane.distance);
    }
    GroundPlane bent = frame.plane;
    bent.distance += off / weights;
    if (const auto point = bent.under(frame.camera.ray(pixel), kFarthestGround))
      out.push_back({pixel, *point});
  }
  return out;
}

cv::Mat greyOf(const cv::Mat& even) {
  cv::Mat out;
  constexpr double kGain = 42, kMiddle = 128;
  even.convertTo(out, CV_8U, kGain, kMiddle);
  return out;
}

Prepared prepare(const Camera& camera, const GroundView& view) {
  Prepared out{{}, {}, camera, view.plane, {}};
  out.even = evenContrast(view.mono, kWidest, out.camera);
  out.grey = greyOf(out.even);
  out.points = pointsOf(out, view.features, static_cast<double>(out.camera.width) / camera.width);
  return out;
}

struct Coarse {
  SE3 T_a_b;
  double correlation = 0;
};

Coarse layOn(const Prepared& a, const Prepared& b, const std::optional<SE3>& reckoned) {
  Coarse best;
  const SE3 T_a_ga = a.plane.T_cam_ground(), T_b_gb = b.plane.T_cam_ground();
  double middle = 0;
  if (reckoned) {
    const Eigen::Matrix3d R_ga_gb = (T_a_ga.inverse() * *reckoned * T_b_gb).matrix3();
    middle = std::atan2(R_ga_gb(1, 0), R_ga_gb(0, 0));
  }
  const int turns = reckoned ? kTurnsReckoned : kTurns;
  const double cell = 0.5 * (a.plane.distance + b.plane.distance) / kCells;
  const GroundPicture fixed = layOut(a.even, a.camera, a.plane, cell, 0);
  for (int k = 0; k < turns; ++k) {
    const double turn = middle + kTurnStep * (k - turns / 2);
    const GroundMatch match = correlate(fixed, layOut(b.even, b.camera, b.plane, cell, turn), kLeastOverlap);
    if (match.correlation <= best.correlation) continue;
    best.correlation = match.correlation;
    const SE3 T_ga_gb(Eigen::Quaterniond(Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ())),
                      {match.shift.x(), match.shift.y(), 0});
    best.T_a_b = T_a_ga * T_ga_gb * T_b_gb.inverse();
  }
  return best;
}

// Places of a's pixels in b, by a's ground plane; (-1, -1) where it is not seen.
cv::Mat placesIn(const Prepared& a, const Prepared& b, const SE3& T_b_a) {
  cv::Mat map(a.camera.height, a.camera.width, CV_32FC2, cv::Scalar(-1, -1));
  for (int y = 0; y < map.rows; ++y)
    for (int x = 0; x < map.cols; ++x)
      if (const auto point = a.plane.under(a.camera.ray({x, y}), kFarthestGround)) {
        const Eigen::Vector3d in_b = T_b_a * *point;
        if (in_b.z() <= 0) continue;
        const Eigen::Vector2d pixel = b.camera.project(in_b);
        if (b.camera.contains(pixel))
          map.at<cv::Vec2f>(y, x) = {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
      }
  return map;
}

// A point of one frame and where the other one shows it.
struct Sighting {
  Eigen::Vector2d from;
  Eigen::Vector3d point;
  Eigen::Vector2d to;
};

int imageCellOf(const Camera& camera, const Eigen::Vector2d& pixel) {
  return static_cast<int>(pixel.x()) * kImageCellsAcross / camera.width +
         kImageCellsAcross * (static_cast<int>(pixel.y()) * kImageCellsDown / camera.height);
}

// a's points in b. `cells`: of a's image, where a point ought to be seen.
std::vector<Sighting> trackedCorners(const Prepared& a, const Prepared& b, const SE3& T_a_b,
                                     std::set<int>& cells) {
  const SE3 T_b_a = T_a_b.inverse();
  const cv::Mat map = placesIn(a, b, T_b_a);
  cv::Mat seen;
  cv::remap(b.even, seen, map, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  std::vector<cv::Point2f> from, to, back;
  std::vector<Sighting> sightings, out;
  for (const GroundPoint& p : a.points) {
    const int x = static_cast<int>(std::lround(p.pixel.x())), y = static_cast<int>(std::lround(p.pixel.y()));
    if (!a.camera.contains(p.pixel, kTrackerWindow / 2.0) || map.at<cv::Vec2f>(y, x)[0] < 0) continue;
    // Off the plane: where its ray from b meets the ground.
    const Eigen::Vector3d& centre = T_a_b.translation();
    const Eigen::Vector3d ray = p.point - centre;
    const double along = a.plane.normal.dot(ray);
    if (!(along > 0)) continue;
    const Eigen::Vector3d ground = centre + (a.plane.distance - a.plane.normal.dot(centre)) / along * ray;
    if (ground.z() <= 0) continue;
    const Eigen::Vector2d expected = a.camera.project(ground);
    if (!a.camera.contains(expected, kTrackerWindow / 2.0)) continue;
    from.emplace_back(static_cast<float>(p.pixel.x()), static_cast<float>(p.pixel.y()));
    to.emplace_back(static_cast<float>(expected.x()), static_cast<float>(expected.y()));
    sightings.push_back({p.pixel, p.point, Eigen::Vector2d::Zero()});
    cells.insert(imageCellOf(a.camera, p.pixel));
  }
  if (from.empty()) return out;
  std::vector<std::uint8_t> forth_good, back_good;
  std::vector<float> residual;
  const cv::Mat grey = greyOf(seen);
  const cv::TermCriteria enough(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 40, 0.005);
  const cv::Size window(kTrackerWindow, kTrackerWindow);
  back = from;
  cv::calcOpticalFlowPyrLK(a.grey, grey, from, to, forth_good, residual, window, kTrackerLevels, enough,
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  cv::calcOpticalFlowPyrLK(grey, a.grey, to, back, back_good, residual, window, kTrackerLevels, enough,
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  for (std::size_t k = 0; k < from.size(); ++k) {
    if (forth_good[k] == 0 || back_good[k] == 0 || cv::norm(back[k] - from[k]) > kMostReturnError) continue;
    const auto ground = a.plane.under(a.camera.ray({to[k].x, to[k].y}), kFarthestGround);
    if (!ground) continue;
    const Eigen::Vector3d in_b = T_b_a * *ground;
    if (in_b.z() <= 0) continue;
    sightings[k].to = b.camera.project(in_b);
    if (b.camera.contains(sightings[k].to)) out.push_back(sightings[k]);
  }
  return out;
}

// Of T_b_a, its residual and the derivative of that by the right perturbation of T_a_b.
double residualOf(const Camera& camera, const SE3& T_b_a, const Sighting& s, Eigen::Vector2d& r,
                  Eigen::Matrix<double, 2, 6>* jacobian) {
  const Eigen::Vector3d p = T_b_a * s.point;
  r = s.to - camera.project(p);
  if (jacobian != nullptr) {
    Eigen::Matrix<double, 2, 3> by_normalised;
    by_normalised << 1 / p.z(), 0, -p.x() / (p.z() * p.z()), 0, 1 / p.z(), -p.y() / (p.z() * p.z());
    Eigen::Matrix<double, 3, 6> by_pose;
    by_pose << -Eigen::Matrix3d::Identity(), crossMatrix(p);
    *jacobian = -camera.pixelJacobian(p.head<2>() / p.z()) * by_normalised * by_pose;
  }
  return r.norm();
}

// Gauss-Newton from where T_a_b is, over those that agree ever better; false where they do not tell a pose.
bool refine(const Camera& camera, const std::vector<Sighting>& sightings, GroundAlignment& out) {
  Matrix6d information;
  double squares = 0;
  for (const double agree : {20.0, 10.0, 5.0, 3.0, kAgree, kAgree, kAgree}) {
    const SE3 T_b_a = out.pose.T_a_b.inverse();
    information.setZero();
    Vector6d gradient = Vector6d::Zero();
    squares = 0;
    out.inliers = 0;
    for (const Sighting& s : sightings) {
      Eigen::Vector2d r;
      Eigen::Matrix<double, 2, 6> j;
      const double off = residualOf(camera, T_b_a, s, r, &j);
      if (off > agree) continue;
      const double weight = 1 / (1 + off * off / (kAgree * kAgree));  // Cauchy's
      information += weight * j.transpose() * j;
      gradient -= weight * j.transpose() * r;
      squares += weight * r.squaredNorm();
      ++out.inliers;
    }
    Vector6d step;
    if (out.inliers < kFewestAgreeing || !solveStep(information, gradient, step)) return false;
    out.pose.T_a_b = perturbed(out.pose.T_a_b, step);
  }
  constexpr double kLeast = 0.3;  // of a coordinate [px]
  const double sigma = std::max(kLeast, std::sqrt(squares / (2.0 * out.inliers - 6)));
  out.pose.covariance = kScale * kScale * sigma * sigma * information.inverse();
  return true;
}

double coverageOf(const Prepared& a, const Prepared& b, const std::vector<Sighting>& sightings,
                  const SE3& T_b_a, const std::set<int>& cells) {
  std::set<int> used;
  for (const Sighting& s : sightings) {
    Eigen::Vector2d r;
    if (residualOf(b.camera, T_b_a, s, r, nullptr) < kAgree) used.insert(imageCellOf(a.camera, s.from));
  }
  return cells.empty() ? 0 : static_cast<double>(used.size()) / static_cast<double>(cells.size());
}

// From where T_a_b is now.
Refusal improve(const Prepared& a, const Prepared& b, GroundAlignment& out) {
  std::set<int> cells;
  std::vector<Sighting> sightings;
  constexpr int kPasses = 2;
  for (int pass = 0; pass < kPasses; ++pass) {
    cells.clear();
    sightings = trackedCorners(a, b, out.pose.T_a_b, cells);
    out.tracked = static_cast<int>(sightings.size());
    if (out.tracked < kFewestAgreeing) return Refusal::kFewMatches;
    if (!refine(b.camera, sightings, out)) return Refusal::kFewInliers;
  }
  out.coverage = coverageOf(a, b, sightings, out.pose.T_a_b.inverse(), cells);
  if (out.inliers < kLeastShare * out.tracked) return Refusal::kLowShare;
  if (out.coverage < kLeastCoverage) return Refusal::kNarrow;
  const double limit = closure::RegistrationConfig{}.max_sigma_position;
  const double variance = out.pose.covariance.topLeftCorner<3, 3>().trace();
  return variance < limit * limit ? Refusal::kNone : Refusal::kVague;
}

}  // namespace

GroundAlignment alignGround(const Camera& camera, const GroundView& view_a, const GroundView& view_b,
                            const std::optional<SE3>& reckoned) {
  const Prepared a = prepare(camera, view_a), b = prepare(camera, view_b);
  const Coarse coarse = layOn(a, b, reckoned);
  GroundAlignment forth, back;
  forth.correlation = back.correlation = coarse.correlation;
  if (coarse.correlation <= 0) return forth;
  forth.pose.T_a_b = coarse.T_a_b;
  forth.refusal = improve(a, b, forth);
  // b may show more of what they share: it is the nearer to it.
  back.pose.T_a_b = coarse.T_a_b.inverse();
  back.refusal = improve(b, a, back);
  if (back.refusal == Refusal::kNone && (forth.refusal != Refusal::kNone || back.inliers > forth.inliers)) {
    const Matrix6d turn = adjoint(back.pose.T_a_b);
    back.pose = {back.pose.T_a_b.inverse(), turn * back.pose.covariance * turn.transpose()};
    return back;
  }
  return forth;
}

}  // namespace fathom::topside

#include "recon/calibration/self_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <optional>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/union_find.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/calibration/opencv_bridge.hpp"

namespace fathom::calibration {
namespace {

using Sighting = RigTrack::Sighting;

const Sighting* sightingIn(const RigTrack& track, std::uint32_t pair, bool right) {
  for (const Sighting& s : track.sightings)
    if (s.pair == pair && s.right == right) return &s;
  return nullptr;
}

// Left and right of the same pair.
struct Match {
  Eigen::Vector2d left, right;
};

std::vector<Match> matchesOf(const RigTracks& seen) {
  std::vector<Match> out;
  for (const RigTrack& track : seen.tracks)
    for (const Sighting& s : track.sightings) {
      if (s.right) continue;
      if (const Sighting* right = sightingIn(track, s.pair, true)) out.push_back({s.pixel, right->pixel});
    }
  return out;
}

Camera guessed(ImageSize size, double focal, double k1) {
  Camera out;
  out.width = size.width, out.height = size.height;
  out.fx = out.fy = focal * size.width;
  out.cx = 0.5 * (size.width - 1), out.cy = 0.5 * (size.height - 1);
  out.k1 = k1;
  return out;
}

// A rig that begins with this focal length [image widths] and distortion, and how many matches it fits.
struct Start {
  StereoRig rig;
  int matches = 0;
};

Start startOf(const RigTracks& seen, const std::vector<Match>& matches, double focal, double k1,
              double baseline) {
  Start out;
  out.rig.left = guessed(seen.left, focal, k1);
  out.rig.right = guessed(seen.right, focal, k1);
  std::vector<cv::Point2d> left, right;
  for (const Match& m : matches) {
    const Eigen::Vector2d l = out.rig.left.undistort(m.left), r = out.rig.right.undistort(m.right);
    left.emplace_back(l.x(), l.y());
    right.emplace_back(r.x(), r.y());
  }
  constexpr double kAgree = 1.0, kConfidence = 0.9999;  // [px]
  cv::Mat inliers, rotation, direction;
  cv::setRNGSeed(1);  // the same trials whatever ran before in this thread
  const cv::Mat identity = cv::Mat::eye(3, 3, CV_64F);
  const cv::Mat essential =
      cv::findEssentialMat(left, right, identity, cv::RANSAC, kConfidence, kAgree / out.rig.left.fx, inliers);
  if (essential.rows != 3 || essential.cols != 3) return out;
  out.matches = cv::recoverPose(essential, left, right, identity, rotation, direction, inliers);
  out.rig.T_right_left = toSE3(rotation, baseline * direction);
  return out;
}

constexpr std::size_t kFewestSightings = 3;  // of a point that constrains the rig

// An even selection of the tracks that are long enough.
RigTracks thinned(const RigTracks& seen, std::size_t most) {
  RigTracks out{seen.left, seen.right, seen.names, {}};
  std::vector<const RigTrack*> good;
  for (const RigTrack& track : seen.tracks)
    if (track.sightings.size() >= kFewestSightings) good.push_back(&track);
  const std::size_t count = std::min(most, good.size());
  for (std::size_t k = 0; k < count; ++k) out.tracks.push_back(*good[k * good.size() / count]);
  return out;
}

// Pose of a pair from points known in its left image.
std::optional<SE3> poseFrom(const Camera& camera, const std::vector<cv::Point3d>& points,
                            const std::vector<cv::Point2d>& seen) {
  constexpr int kFewest = 20, kTrials = 1000;
  constexpr double kAgree = 4.0, kConfidence = 0.9999;  // [px]; wide, as the rig is a first guess
  if (points.size() < kFewest) return std::nullopt;
  cv::Mat rotation, translation, matrix;
  std::vector<int> inliers;
  cv::setRNGSeed(1);
  if (!cv::solvePnPRansac(points, seen, matrixOf(camera), distortionOf(camera), rotation, translation, false,
                          kTrials, kAgree, kConfidence, inliers) ||
      inliers.size() < kFewest)
    return std::nullopt;
  cv::Rodrigues(rotation, matrix);
  return cv::checkRange(matrix) && cv::checkRange(translation) ? std::optional(toSE3(matrix, translation))
                                                               : std::nullopt;
}

// Poses and points by a rig, pair after pair, as far as points of earlier pairs are in view again.
class Model {
 public:
  Model(const RigTracks& seen, const StereoRig& rig) : seen_(seen) {
    bundle_.rig = rig;
    bundle_.poses.resize(seen.names.size());
    point_.assign(seen.tracks.size(), kNone);
    by_pair_.resize(seen.names.size());
    for (std::uint32_t k = 0; k < seen.tracks.size(); ++k)
      for (const Sighting& s : seen.tracks[k].sightings)
        if (!s.right) by_pair_[s.pair].push_back(k);
    for (std::uint32_t pair = 0; pair < seen.names.size(); ++pair) {
      bundle_.poses[pair].T_left_world = resected(pair).value_or(SE3());
      triangulate(pair);
    }
    addSightings();
  }

  RigBundle& bundle() { return bundle_; }

  // Selects the sightings within the threshold, of points with at least three of them; of a point in several
  // connected parts of the pairs, those of one part. The first pair of each part is fixed. Returns the number
  // of sightings.
  std::size_t choose(double most_px) {
    for (RigBundle::Sighting& s : bundle_.sightings) s.used = bundle_.residual(s).norm() < most_px;
    needThree();
    UnionFind parts = joinedPairs();
    std::uint32_t at = 0;
    while (at < bundle_.sightings.size()) {
      std::uint32_t end = at;
      std::map<std::uint32_t, int> in_part;
      for (; end < bundle_.sightings.size() && bundle_.sightings[end].point == bundle_.sightings[at].point;
           ++end)
        in_part[parts.root(bundle_.sightings[end].pose)] += bundle_.sightings[end].used;
      const auto most = std::max_element(in_part.begin(), in_part.end(),
                                         [](const auto& a, const auto& b) { return a.second < b.second; });
      for (; at < end; ++at) {
        RigBundle::Sighting& s = bundle_.sightings[at];
        s.used = s.used && parts.root(s.pose) == most->first;
      }
    }
    for (std::uint32_t k = 0; k < bundle_.poses.size(); ++k) bundle_.poses[k].fixed = parts.root(k) == k;
    return needThree();
  }

  [[nodiscard]] std::vector<double> residuals() const {
    std::vector<double> out;
    for (const RigBundle::Sighting& s : bundle_.sightings)
      if (s.used) out.push_back(bundle_.residual(s).norm());
    return out;
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;

  std::size_t needThree() {
    std::vector<std::size_t> of_point(bundle_.points.size(), 0);
    for (const RigBundle::Sighting& s : bundle_.sightings) of_point[s.point] += s.used;
    std::size_t used = 0;
    for (RigBundle::Sighting& s : bundle_.sightings) {
      s.used = s.used && of_point[s.point] >= kFewestSightings;
      used += s.used;
    }
    return used;
  }

  // Connected parts of the pairs: two are joined by enough common points of their left images.
  UnionFind joinedPairs() const {
    constexpr int kEnough = 15;
    const std::size_t pairs = bundle_.poses.size();
    std::vector<int> common(pairs * pairs, 0);
    std::vector<std::uint32_t> seeing;
    for (std::size_t k = 0; k < bundle_.sightings.size(); ++k) {
      const RigBundle::Sighting& s = bundle_.sightings[k];
      if (k > 0 && bundle_.sightings[k - 1].point != s.point) seeing.clear();
      if (!s.used || s.right) continue;
      for (const std::uint32_t other : seeing) ++common[other * pairs + s.pose];
      seeing.push_back(s.pose);
    }
    UnionFind parts(pairs);
    for (std::uint32_t a = 0; a < pairs; ++a)
      for (std::uint32_t b = a + 1; b < pairs; ++b)
        if (common[a * pairs + b] + common[b * pairs + a] >= kEnough) parts.join(a, b);
    return parts;
  }

  std::optional<SE3> resected(std::uint32_t pair) const {
    std::vector<cv::Point3d> points;
    std::vector<cv::Point2d> seen;
    for (const std::uint32_t k : by_pair_[pair]) {
      if (point_[k] == kNone) continue;
      const Eigen::Vector3d& p = bundle_.points[point_[k]];
      const Eigen::Vector2d& pixel = sightingIn(seen_.tracks[k], pair, false)->pixel;
      points.emplace_back(p.x(), p.y(), p.z());
      seen.emplace_back(pixel.x(), pixel.y());
    }
    return poseFrom(bundle_.rig.left, points, seen);
  }

  void triangulate(std::uint32_t pair) {
    const SE3 T_world_left = bundle_.poses[pair].T_left_world.inverse();
    for (const std::uint32_t k : by_pair_[pair]) {
      if (point_[k] != kNone) continue;
      const Sighting* right = sightingIn(seen_.tracks[k], pair, true);
      if (right == nullptr) continue;
      Eigen::Vector3d point;
      double gap = 0;
      constexpr double kMostGap = 0.1;  // of the baseline
      if (!triangulateMidpoint(bundle_.rig,
                               bundle_.rig.left.ray(sightingIn(seen_.tracks[k], pair, false)->pixel),
                               bundle_.rig.right.ray(right->pixel), point, gap) ||
          gap > kMostGap * bundle_.rig.baseline())
        continue;
      point_[k] = static_cast<std::uint32_t>(bundle_.points.size());
      bundle_.points.push_back(T_world_left * point);
    }
  }

  void addSightings() {
    for (std::uint32_t k = 0; k < seen_.tracks.size(); ++k)
      if (point_[k] != kNone)
        for (const Sighting& s : seen_.tracks[k].sightings)
          bundle_.sightings.push_back({s.pair, point_[k], s.right, s.pixel, true});
  }

  const RigTracks& seen_;
  RigBundle bundle_;                                 // sightings of a point after each other
  std::vector<std::uint32_t> point_;                 // of a track
  std::vector<std::vector<std::uint32_t>> by_pair_;  // tracks in its left image
};

// Adjusts, with a tighter gate each time. Returns the number of sightings within the last.
std::size_t refine(Model& model, const SelfCalibrationConfig& config, std::initializer_list<double> px) {
  std::size_t used = 0;
  for (const double most : px) {
    used = model.choose(most);
    if (used == 0) return 0;
    adjust(model.bundle(), config.bundle);
  }
  return used;
}

RigCalibration calibrationOf(const RigTracks& seen, Model& model) {
  const RigBundle& bundle = model.bundle();
  RigCalibration out;
  out.rig = bundle.rig;
  std::vector<CalibratedView> views(seen.names.size());
  std::vector<std::vector<double>> depths(views.size());
  for (const RigBundle::Sighting& s : bundle.sightings) {
    if (!s.used) continue;
    CalibratedView& view = views[s.pose];
    (s.right ? view.right : view.left).push_back(s.pixel);
    (s.right ? view.right_residuals : view.left_residuals).push_back(bundle.residual(s));
    if (!s.right) depths[s.pose].push_back((bundle.poses[s.pose].T_left_world * bundle.points[s.point]).z());
  }
  for (std::uint32_t pair = 0; pair < views.size(); ++pair) {
    CalibratedView& view = views[pair];
    view.name = seen.names[pair];
    if (view.left.empty() && view.right.empty()) {
      out.dropped.push_back({view.name, "shows nothing that other pairs show"});
      continue;
    }
    view.distance = median(depths[pair]);
    measure(view);
    out.views.push_back(std::move(view));
  }
  measure(out);
  return out;
}

}  // namespace

RigCalibration selfCalibrate(const RigTracks& seen, double baseline, const SelfCalibrationConfig& config,
                             const std::string& source) {
  const std::vector<Match> matches = matchesOf(seen);
  constexpr std::size_t kFewestPlaces = 50;
  if (matches.size() < kFewestPlaces)
    throw InputError(source, "",
                     "left and right show only " + std::to_string(matches.size()) +
                         " places in common; are they pairs of one rig, taken at the same moments?");
  constexpr std::size_t kStartPerPair = 150, kPerPair = 600;  // tracks
  constexpr int kStartSteps = 20;
  const RigTracks some = thinned(seen, kStartPerPair * seen.names.size());
  const RigTracks all = thinned(seen, kPerPair * seen.names.size());
  SelfCalibrationConfig quick = config;
  quick.bundle.steps = std::min(kStartSteps, config.bundle.steps);
  std::optional<StereoRig> best;
  std::size_t most = 0;
  for (const double focal : {0.7, 1.0, 1.4, 2.0, 2.8}) {
    Start start;
    for (const double k1 : {-0.3, -0.1, 0.0, 0.15, 0.3}) {
      Start one = startOf(seen, matches, focal, k1, baseline);
      if (one.matches > start.matches) start = std::move(one);
    }
    if (start.matches == 0) continue;
    Model model(some, start.rig);
    const std::size_t fit = refine(model, quick, {20.0, 8.0, 4.0});
    if (fit == 0) continue;
    const std::size_t good = model.choose(2.0);
    if (good <= most) continue;
    most = good;
    best = model.bundle().rig;
  }
  if (!best) throw InputError(source, "", "no rig fits what left and right show");
  // Again from its cameras, to gain pairs and points that the first guess lost.
  Model model(all, *best);
  refine(model, config, {8.0, config.gross_px, config.gross_px});
  const double sigma = median(model.residuals()) / std::sqrt(2 * std::numbers::ln2);  // Rayleigh
  refine(model, config, {std::max(config.gross * sigma, 1.0)});
  RigCalibration out = calibrationOf(all, model);
  const auto joined = static_cast<int>(out.views.size());
  if (joined < config.least_pairs)
    throw InputError(source, "",
                     "only " + std::to_string(joined) +
                         " pairs show the same ground as another one; at least " +
                         std::to_string(config.least_pairs) + " are needed");
  const bool solved = bundleUncertainty(model.bundle(), config.bundle, out.sigma);
  const double focal = std::max(out.sigma.left.fx / out.rig.left.fx, out.sigma.right.fx / out.rig.right.fx);
  if (!solved || focal > config.most_focal_sigma || out.sigma.rotation.maxCoeff() > config.most_turn_sigma)
    throw InputError(
        source, "",
        "the images do not determine the rig: " +
            (solved ? "focal length known to " + decimals(100 * focal, 1) + " %, turn to " +
                          decimals(kDegreesPerRadian * out.sigma.rotation.maxCoeff(), 2) + " degrees"
                    : std::string("the system is singular")) +
            "; add pairs that overlap, with relief, tilt and turns, or calibrate with a board");
  return out;
}

}  // namespace fathom::calibration

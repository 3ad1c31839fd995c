#include "realtime/onboard/map/map_core.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/stereo/seed_plane.hpp"

namespace fathom::onboard {
namespace {

// Errors of GPS are correlated over minutes: fixes closer together than this carry no new information, and
// only one of them is used.
constexpr std::int64_t kGpsInterval_ns = 60'000'000'000;
// A camera looks ahead if the cosine of the angle between its optical axis and down is below this.
constexpr double kLeastDownCosine = 0.3;
constexpr double kFirstDepth = 2.0;  // assumed before any stereo, the vehicle class's survey altitude [m]

bool shaped(const ImageView& image, const Camera& camera) {
  return !image.empty() && image.width == camera.width && image.height == camera.height;
}

void measureFootprint(const Mesh& mesh, MapOutput& out) {
  if (mesh.vertices.empty()) return;
  Eigen::AlignedBox2f box;
  for (const Eigen::Vector3f& v : mesh.vertices) box.extend(Eigen::Vector2f(v.head<2>()));
  out.min_north_east = box.min().cast<double>();
  out.max_north_east = box.max().cast<double>();
  for (const Eigen::Vector3f& v : mesh.vertices)
    out.footprint_radius =
        std::max(out.footprint_radius, static_cast<double>((v.head<2>() - box.center()).norm()));
}

// `z`: scratch buffer.
double medianRange(const stereo::StereoResult& result, std::vector<float>& z) {
  z.clear();
  for (const stereo::StereoPoint& p : result.points) z.push_back(p.point.z());
  return median(std::span(z));
}

}  // namespace

MapCore::MapCore(const MapCoreConfig& config, const MapSlots& slots)
    : config_(config),
      rig_(config.rig),
      left_light_(config.rig.left.width, config.rig.left.height, config.left_format, config.bits,
                  config.lighting),
      right_light_(config.rig.right.width, config.rig.right.height, config.right_format, config.bits,
                   config.lighting),
      ranges_(config.rig),
      stereo_(config.rig, config.stereo),
      given_stereo_(config.rig, config.stereo),
      map_(config.map, config.localisation.enabled ? slots.meshes : nullptr,
           static_cast<std::size_t>(config.stereo.max_features), rig_.history()),
      anchor_(config.localisation.graph.noise.usbl_shift),
      last_range_(kFirstDepth),
      mosaic_(std::max(pixelsOf(config.rig.left) * samplesPerPixel(config.left_format),
                       pixelsOf(config.rig.right) * samplesPerPixel(config.right_format))),
      rgb_(3 * std::max(pixelsOf(config.rig.left), pixelsOf(config.rig.right))),
      left_mono_(pixelsOf(config.rig.left)),
      right_mono_(pixelsOf(config.rig.right)) {
  if (config.colours) matrix_.emplace(*config.colours);
  const auto most_points = static_cast<std::size_t>(config.stereo.max_features);
  points_.reserve(most_points);
  point_ranges_.reserve(most_points);
  scratch_.resize(most_points);
  mesh_.vertices.reserve(most_points);
  mesh_.normals.reserve(most_points);
  mesh_.colours.reserve(most_points);
  mesh_.sigma.reserve(most_points);
  mesh_.triangles.reserve(2 * most_points);
  right_points_.resize(static_cast<std::size_t>(config.stereo.max_features));
  if (!config.localisation.enabled) return;
  localisation_ = std::make_unique<LocalisationCore>(rig_.history(), config.localisation, slots.features);
  localisation_->setRetiredObserver([this](const slam::NavigationGraph::Retired& retired) {
    map_.reattach(retired);
    if (on_retired_) on_retired_(retired);
  });
}

void MapCore::setStageObserver(std::function<void(const char* stage)> observer) {
  observer_ = std::move(observer);
  if (localisation_) localisation_->setStageObserver(observer_);
}

void MapCore::addFix(nav::FixKind kind, std::int64_t utc_ns, const Eigen::Vector3d& antenna_in_odom,
                     const Eigen::Vector2d& north_east, double sigma, double unlocked_s) {
  anchor_.add(kind, north_east - antenna_in_odom.head<2>(), sigma, unlocked_s);
  if (frame_fixed_) {
    if (!localisation_) return;
    if (kind == nav::FixKind::kGps) {
      if (std::abs(utc_ns - last_gps_ns_) < kGpsInterval_ns) return;
      last_gps_ns_ = utc_ns;
    }
    localisation_->addFix(kind, utc_ns, antenna_in_odom, north_east, sigma);
    anchored_ = true;
    return;
  }
  anchorAt(std::max(unlocked_s, 0.0));
}

void MapCore::anchorAt(double unlocked_s) {
  const double drift = config_.localisation.graph.noise.unknown_velocity;
  const auto estimate = anchor_.estimate(unlocked_s, drift);
  if (!estimate) return;
  T_nav_odom_ = SE3(Eigen::Quaterniond::Identity(), {estimate->shift.x(), estimate->shift.y(), 0.0});
  anchor_sigma_ = estimate->sigma;
  anchored_ = true;
  if (!localisation_) return;
  for (const nav::FixKind kind : {nav::FixKind::kGps, nav::FixKind::kUsbl})
    if (const auto of_kind = anchor_.estimate(kind, unlocked_s, drift))
      localisation_->setAnchor(kind, of_kind->shift, of_kind->sigma);
}

SE3 MapCore::poseOf(int keyframe, const SE3& T_odom_cam) const {
  return keyframe < 0 ? T_nav_odom_ * T_odom_cam : localisation_->poseOf(keyframe, T_odom_cam);
}

std::optional<double> MapCore::positionSigma(std::int64_t utc_ns, const SE3& T_odom_body,
                                             const nav::DeadReckoning::Quality& quality) const {
  if (!localisation_ || localisation_->keyframes() == 0) return std::nullopt;
  return localisation_->positionSigma(utc_ns, T_odom_body * config_.T_body_cam, quality);
}

int MapCore::look(const MapInput& input, const SeenPair& pair, bool images) {
  if (!localisation_) return LocalisationCore::kNoKeyframe;
  LocalisationInput frame;
  frame.utc_ns = input.utc_ns;
  frame.T_odom_cam = pair.output.T_odom_cam;
  frame.quality = input.quality;
  frame.range = pair.range;
  if (input.features != nullptr) {
    closure::GivenFeatureLimits limits;
    limits.max_features = config_.localisation.features;
    limits.depths = depthsAbout(pair.range);
    closure::featuresFrom(*input.features, rig_.rig(), limits, given_features_);
    frame.features = &given_features_;
    ended("features given");
  } else if (images) {
    frame.left = eightBitView(left_mono_, config_.rig.left, PixelFormat::kMono);
    frame.right = eightBitView(right_mono_, config_.rig.right, PixelFormat::kMono);
  }
  return localisation_->look(frame);
}

Mesh MapCore::mesh() {
  Mesh mesh = fusion::toMesh(map_.map());
  if (!localisation_ || mesh.empty()) return mesh;
  computeNormals(mesh);
  addPoseVariance(localisation_->views(), mesh);
  mesh.normals.clear();
  return mesh;
}

void MapCore::finish() {
  if (!localisation_) return;
  localisation_->finish();
  localisation_->takeChanges();
  T_nav_odom_ = localisation_->T_nav_odom();
  map_.finish([this](int k, const SE3& T) { return poseOf(k, T); }, on_moved_);
}

stereo::SeedPlane MapCore::seedPlane(const MapInput& input) const {
  const SE3 T_odom_cam = input.T_odom_body * config_.T_body_cam;
  const Eigen::Vector3d down_cam = T_odom_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  // For a camera that looks ahead the DVL's altitude does not describe the surface in view.
  if (!input.altitude || down_cam.z() < kLeastDownCosine) return {Eigen::Vector3d::UnitZ(), last_range_};
  const double dvl_depth = (input.T_odom_body * config_.T_body_dvl.translation()).z();
  return {down_cam, dvl_depth + *input.altitude - T_odom_cam.translation().z()};
}

void MapCore::correctPair(const MapInput& input, bool by_range) {
  static const lighting::RangeLattice kUnknown;
  if (left_light_.images() == 0) left_light_.add(input.left, ranges_.left(), input.left_exposure_s);
  if (right_light_.images() == 0) right_light_.add(input.right, ranges_.right(), input.right_exposure_s);
  left_light_.grey(input.left, by_range ? ranges_.left() : kUnknown, mosaic_.data(), rgb_.data(),
                   left_mono_.data(), input.left_exposure_s);
  right_light_.grey(input.right, by_range ? ranges_.right() : kUnknown, mosaic_.data(), rgb_.data(),
                    right_mono_.data(), input.right_exposure_s);
}

void MapCore::learnLight(const MapInput& input, double range, const stereo::StereoResult& result) {
  points_.clear();
  for (const stereo::StereoPoint& p : result.points) points_.push_back(p.point);
  if (right_points_.size() < points_.size()) right_points_.resize(points_.size());
  ranges_.bendTo(points_, right_points_);
  const Camera& camera = config_.rig.left;
  const double footprint = range * std::min(camera.width / camera.fx, camera.height / camera.fy);
  if (new_ground_.take(input.T_odom_body * config_.T_body_cam.translation(), footprint)) {
    left_light_.add(input.left, ranges_.left(), input.left_exposure_s);
    right_light_.add(input.right, ranges_.right(), input.right_exposure_s);
  }
  left_light_.colours(input.left, ranges_.left(), mosaic_.data(), rgb_.data(),
                      {.exposure_s = input.left_exposure_s});
}

template <typename Match>
const stereo::StereoResult& MapCore::matchWithRig(const Match& match) {
  const stereo::StereoResult& result = match();
  if (!rig_.correctAtStart(result.matches)) return result;
  useRig(config_.rig);
  return match();
}

const stereo::StereoResult& MapCore::seeImages(const MapInput& input, const stereo::SeedPlane& expected) {
  stereo::SeedPlane plane = expected;
  const auto match = [&](bool by_range) -> const stereo::StereoResult& {
    ranges_.fromPlane(plane.normal, plane.distance);
    correctPair(input, by_range);
    ended("lighting");
    return stereo_.process(eightBitView(left_mono_, config_.rig.left, PixelFormat::kMono),
                           eightBitView(right_mono_, config_.rig.right, PixelFormat::kMono), plane,
                           input.max_features);
  };
  const stereo::StereoResult& result =
      matchWithRig([&]() -> const stereo::StereoResult& { return match(true); });
  stereo::matchWhereGroundIs(result, plane, scratch_, match);
  ended("stereo");
  learnLight(input, plane.ahead(), result);
  stereo::toMesh(result, eightBitView(rgb_, config_.rig.left, PixelFormat::kRgb), mesh_);
  if (matrix_ && !mesh_.colours.empty())
    matrix_->apply({mesh_.colours.front().data(), 3 * mesh_.colours.size()});
  ended("lighting learns");
  return result;
}

const stereo::StereoResult& MapCore::seeFeatures(const MapInput& input) {
  const stereo::StereoResult& result =
      matchWithRig([&]() -> const stereo::StereoResult& { return given_stereo_.process(*input.features); });
  stereo::toMesh(result, *input.features, mesh_);
  ended("stereo");
  return result;
}

void MapCore::count(const stereo::StereoResult& result) {
  counters_.points += result.points.size();
  counters_.rejected.no_track += result.rejected.no_track;
  counters_.rejected.left_right += result.rejected.left_right;
  counters_.rejected.epipolar += result.rejected.epipolar;
  counters_.rejected.range += result.rejected.range;
  counters_.rejected.outlier += result.rejected.outlier;
  counters_.rejected.fish += result.rejected.fish;
  if (result.triangles.empty()) ++counters_.pairs_without_points;
}

void MapCore::updateRig(std::span<const RigMatch> matches, std::int64_t utc_ns) {
  const StereoRig before = rig_.rig();
  const std::uint64_t measurements_before = rig_.measurements(), resets_before = rig_.resets();
  const std::uint64_t changes_before = resets_before == 0 ? 0 : rig_.changes();
  bool changed = rig_.add(matches);
  // Steps up to the last measurement that did not show a knock are unaffected by it.
  const std::int64_t since_ns = measured_ns_;
  if (rig_.measurements() != measurements_before) measured_ns_ = utc_ns;
  if (rig_.resets() != resets_before) {
    if (changed) useRig(before);
    // The range error estimated so far belongs to the previous calibration.
    if (localisation_) localisation_->resetRig(rig_.yawSigma(), since_ns, rig_.changes() != changes_before);
    return;
  }
  if (localisation_ && rig_.resets() > 0) {
    // A range error is systematic over all points, so averaging does not reduce it: it is corrected from half
    // its standard deviation on.
    constexpr double kCorrectedSigmas = 0.5, kLeastCorrection = 5e-4;  // [1], of the range
    const slam::DvlCalibration& dvl = localisation_->graph().dvl();
    const calibration::RangeError error{dvl.rangeError().x(), dvl.rangeError().y()};
    const double least =
        std::max(kCorrectedSigmas * dvl.rangeSigma(last_range_), kLeastCorrection * rig_.history().worth());
    if (std::abs(error.at(last_range_)) > least) {
      rig_.correctRange(error);
      changed = true;
    }
  }
  if (changed) useRig(before);
}

void MapCore::useRig(const StereoRig& before) {
  const StereoRig& rig = rig_.rig();
  ranges_ = lighting::RigRanges(rig);
  stereo_.setRig(rig);
  given_stereo_.setRig(rig);
  if (!localisation_) return;
  (void)map_.noteMoved();
  const calibration::RangeError growth = calibration::rangeChange(before, rig);
  localisation_->setRig(rig, {growth.scale, growth.per_metre});
}

SeenPair MapCore::see(const MapInput& input) {
  if (!frame_fixed_) anchorAt(input.quality.unlocked_s);
  frame_fixed_ = true;
  SeenPair pair;
  MapOutput& out = pair.output;
  out.pair_index = input.pair_index;
  out.utc_ns = input.utc_ns;
  out.T_odom_cam = input.T_odom_body * config_.T_body_cam;
  out.T_nav_cam = T_nav_odom_ * out.T_odom_cam;
  if (localisation_) out.keyframe = localisation_->keyframes() - 1;
  pair.closures = input.closures;
  pair.rebuild_meshes = input.rebuild_meshes < 0 ? config_.rebuild_meshes : input.rebuild_meshes;
  ++counters_.pairs;
  if (input.features == nullptr &&
      (!shaped(input.left, config_.rig.left) || !shaped(input.right, config_.rig.right))) {
    ++counters_.bad_images;
    pair.range = last_range_;
    pair.looked = look(input, pair, false);
    return pair;
  }
  const stereo::SeedPlane plane = seedPlane(input);
  const stereo::StereoResult& result =
      input.features != nullptr ? seeFeatures(input) : seeImages(input, plane);
  count(result);
  out.points = result.points.size();
  out.triangles = result.triangles.size();
  out.median_range = medianRange(result, point_ranges_);
  pair.range = out.median_range > 0 ? out.median_range : plane.ahead();
  map_.noteVehicle(out.T_nav_cam.translation().head<2>());
  if (!result.triangles.empty()) {
    last_range_ = out.median_range;
    const MovingMap::Added added = map_.add(mesh_, out.keyframe, out.T_odom_cam, out.T_nav_cam);
    out.nodes_updated = added.cells;
    pair.slot = added.slot;
    measureFootprint(mesh_, out);
    ended("map");
  }
  pair.looked = look(input, pair, true);
  // Last, because this pair was processed with the rig as it was estimated before.
  updateRig(result.matches, input.utc_ns);
  return pair;
}

MapOutput MapCore::place(const SeenPair& pair, const SE3& T_odom_body,
                         const nav::DeadReckoning::Quality& quality) {
  MapOutput out = pair.output;
  if (!localisation_) return out;
  out.T_odom_cam = T_odom_body * config_.T_body_cam;
  LocalisationInput frame;
  frame.utc_ns = out.utc_ns;
  frame.T_odom_cam = out.T_odom_cam;
  frame.quality = quality;
  frame.range = pair.range;
  frame.closures = pair.closures;
  out.keyframe = localisation_->place(frame, pair.looked);
  T_nav_odom_ = localisation_->T_nav_odom();
  anchor_sigma_ = localisation_->positionSigma();
  out.T_nav_cam = poseOf(out);
  if (localisation_->moved() && map_.noteMoved()) localisation_->takeChanges();
  const auto pose_of = [this](int k, const SE3& T) { return poseOf(k, T); };
  if (out.triangles > 0)
    map_.correct(pair.slot, pair.output.T_odom_cam, out.keyframe, out.T_odom_cam, pose_of);
  map_.rebuild(pair.rebuild_meshes, pose_of, on_moved_);
  ended("map rebuild");
  return out;
}

}  // namespace fathom::onboard

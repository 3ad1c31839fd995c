#include "realtime/onboard/map/map_core.hpp"

#include <algorithm>
#include <cmath>

#include "recon/geometry/eight_bit_view.hpp"

namespace fathom::onboard {
namespace {

constexpr double kNominalRange = 2.0;  // survey altitude of the vehicle class [m]

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

double medianRange(const stereo::StereoResult& result) {
  if (result.points.empty()) return 0;
  std::vector<float> z;
  z.reserve(result.points.size());
  for (const stereo::StereoPoint& p : result.points) z.push_back(p.point.z());
  const auto middle = z.begin() + static_cast<std::ptrdiff_t>(z.size() / 2);
  std::nth_element(z.begin(), middle, z.end());
  return *middle;
}

}  // namespace

MapCore::MapCore(const MapCoreConfig& config)
    : config_(config),
      left_light_(config.rig.left.width, config.rig.left.height, config.left_format, config.bits,
                  config.lighting),
      right_light_(config.rig.right.width, config.rig.right.height, config.right_format, config.bits,
                   config.lighting),
      ranges_(config.rig),
      stereo_(config.rig, config.stereo),
      map_(config.map),
      last_range_(kNominalRange),
      left_mosaic_(pixelsOf(config.rig.left) * samplesPerPixel(config.left_format)),
      left_mono_(pixelsOf(config.rig.left)),
      left_rgb_(3 * pixelsOf(config.rig.left)),
      right_mosaic_(pixelsOf(config.rig.right) * samplesPerPixel(config.right_format)),
      right_mono_(pixelsOf(config.rig.right)) {
  points_.reserve(static_cast<std::size_t>(config.stereo.max_features));
  right_points_.resize(static_cast<std::size_t>(config.stereo.max_features));
}

void MapCore::addFix(nav::FixKind kind, const Eigen::Vector2d& difference, double sigma) noexcept {
  anchor_.add(kind, difference, sigma);
  if (frame_fixed_) return;
  if (const auto estimate = anchor_.estimate()) {
    T_nav_odom_ = SE3(Eigen::Quaterniond::Identity(), {estimate->shift.x(), estimate->shift.y(), 0.0});
    anchor_sigma_ = estimate->sigma;
    anchored_ = true;
  }
}

stereo::SeedPlane MapCore::seedPlane(const MapInput& input) const {
  const SE3 T_odom_cam = input.T_odom_body * config_.T_body_cam;
  const Eigen::Vector3d down_cam = T_odom_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  if (!input.altitude) return {Eigen::Vector3d::UnitZ(), last_range_};
  const double dvl_depth = (input.T_odom_body * config_.T_body_dvl.translation()).z();
  return {down_cam, dvl_depth + *input.altitude - T_odom_cam.translation().z()};
}

void MapCore::correctPair(const MapInput& input) {
  if (left_light_.images() == 0) left_light_.add(input.left, ranges_.left());
  if (right_light_.images() == 0) right_light_.add(input.right, ranges_.right());
  left_light_.correct(input.left, ranges_.left(), left_mosaic_.data());
  right_light_.correct(input.right, ranges_.right(), right_mosaic_.data());
  lighting::demosaicMono(eightBitView(left_mosaic_, config_.rig.left, config_.left_format),
                         left_mono_.data());
  lighting::demosaicMono(eightBitView(right_mosaic_, config_.rig.right, config_.right_format),
                         right_mono_.data());
}

void MapCore::learnLight(const MapInput& input, const stereo::StereoResult& result) {
  points_.clear();
  for (const stereo::StereoPoint& p : result.points) points_.push_back(p.point);
  if (right_points_.size() < points_.size()) right_points_.resize(points_.size());
  ranges_.bendTo(points_, right_points_);
  left_light_.add(input.left, ranges_.left());
  right_light_.add(input.right, ranges_.right());
  left_light_.correct(input.left, ranges_.left(), left_mosaic_.data());
  lighting::demosaicRgb(eightBitView(left_mosaic_, config_.rig.left, config_.left_format), left_rgb_.data());
}

MapOutput MapCore::process(const MapInput& input) {
  frame_fixed_ = true;
  MapOutput out;
  out.pair_index = input.pair_index;
  out.utc_ns = input.utc_ns;
  out.T_nav_cam = T_nav_odom_ * input.T_odom_body * config_.T_body_cam;
  ++counters_.pairs;
  if (!shaped(input.left, config_.rig.left) || !shaped(input.right, config_.rig.right)) {
    ++counters_.bad_images;
    return out;
  }
  const stereo::SeedPlane plane = seedPlane(input);
  ranges_.fromPlane(plane.normal, plane.distance);
  correctPair(input);

  const stereo::StereoResult& result = stereo_.process(
      eightBitView(left_mono_, config_.rig.left, PixelFormat::kMono),
      eightBitView(right_mono_, config_.rig.right, PixelFormat::kMono), plane, input.max_features);
  learnLight(input, result);
  counters_.points += result.points.size();
  counters_.rejected.no_track += result.rejected.no_track;
  counters_.rejected.left_right += result.rejected.left_right;
  counters_.rejected.epipolar += result.rejected.epipolar;
  counters_.rejected.range += result.rejected.range;
  counters_.rejected.outlier += result.rejected.outlier;
  counters_.rejected.fish += result.rejected.fish;
  out.points = result.points.size();
  out.triangles = result.triangles.size();
  out.median_range = medianRange(result);
  if (result.triangles.empty()) {
    ++counters_.pairs_without_points;
    return out;
  }
  last_range_ = out.median_range;
  Mesh mesh = stereo::toMesh(result, eightBitView(left_rgb_, config_.rig.left, PixelFormat::kRgb));
  transform(mesh, out.T_nav_cam);
  measureFootprint(mesh, out);
  out.nodes_updated = map_.fuse(mesh);
  return out;
}

}  // namespace fathom::onboard

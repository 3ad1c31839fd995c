#include "sim/features/feature_camera.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>

#include "sim/features/landmarks.hpp"
#include "sim/features/match_errors.hpp"
#include "sim/scenario/random.hpp"
#include "sim/sea/ground/noise.hpp"
#include "sim/sea/ground/surface_scene.hpp"
#include "sim/sea/light/water_light.hpp"

namespace fathom::sim {
namespace {

constexpr double kLargestSize = 4;       // of a feature, by the smallest
constexpr double kBorder_px = 8;         // windows at the border find no match [px]
constexpr double kNearestPoint_m = 0.1;  // least depth before a camera
constexpr float kFarthest = 100.0F;      // of a ray [m]
constexpr float kStart = 100.0F;         // above the terrain, of a ray that falls [m]
constexpr double kHidden = 0.01;         // a landmark this much behind what is seen is hidden [m]
constexpr int kProbes = 7;               // a side, of the rays that find the area seen
constexpr int kFieldCells = 2;           // across the image, of the smooth part of the place noise
constexpr double kDescriptorTail = 0.6;  // of the logarithm of the descriptor's noise, standard deviation
constexpr double kMaxDescriptorNoise = 1.9;
constexpr std::uint64_t kMatchStream = 0x6d61746368;  // of random numbers
constexpr int kShared = 6;                            // errors that all features share
constexpr float kNoiseStep = 1.0F / 128;              // of the descriptor's noise

// Normal deviates that are a function of a seed and a key.
class NormalDeviates {
 public:
  NormalDeviates(std::uint64_t seed, std::uint64_t key) : random_(seed, key) {}
  double operator()() {
    const double radius = std::sqrt(-2 * std::log(1 - random_.uniform()));
    return radius * std::cos(2 * std::numbers::pi * random_.uniform());
  }
  Eigen::Vector2d both() {
    const double x = (*this)();
    return {x, (*this)()};
  }
  double uniform() { return random_.uniform(); }

 private:
  GroundRandom random_;
};

// A smooth random field of unit variance over the image: normal deviates on a lattice of `cell_px`,
// interpolated bilinearly with weights normalised to a unit sum of squares.
Eigen::Vector2d smoothField(std::uint64_t seed, const Eigen::Vector2d& pixel, double cell_px) {
  const double x = pixel.x() / cell_px + 1, y = pixel.y() / cell_px + 1;
  const double i = std::floor(x), j = std::floor(y), u = x - i, v = y - j;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double squares = 0;
  for (int k = 0; k < 4; ++k) {
    const int di = k % 2, dj = k / 2;
    const double weight = (di == 1 ? u : 1 - u) * (dj == 1 ? v : 1 - v);
    NormalDeviates normals(seed, static_cast<std::uint64_t>((j + dj) * 4096 + i + di));
    sum += weight * normals.both();
    squares += weight * weight;
  }
  return sum / std::sqrt(squares);
}

// The seafloor inside the left camera's view, sampled by probe rays.
struct VisibleArea {
  std::vector<Eigen::Vector2d> hits;                // of the probe rays, north and east [m]
  double nearest = 0, farthest = 0;                 // their z in the left camera [m]
  Eigen::Vector3d plane = Eigen::Vector3d::Zero();  // depth = plane . (north, east, 1), by least squares
};

struct FoundFeature {
  StereoFeature feature;
  Eigen::Vector3d point;  // nav [m]
  std::uint64_t key, appearance;
  float noise;      // of the descriptor, by its own spread
  double strength;  // probability that it is found
};

// Ratio of texture contrast to pixel noise in the left camera: the strobes' light as Renderer computes it,
// but without shadows and backscatter, against shot and read noise.
class FeatureLight {
 public:
  // `contrast`: standard deviation of the texture by the albedo. Throws std::invalid_argument when no strobe
  // lights the point that the exposure is set by.
  FeatureLight(const OpticsConfig& optics, const SE3& T_body_cam, double contrast);

  // Standard deviation of the texture over that of a pixel's noise. `point` and unit `normal` in body.
  [[nodiscard]] double contrastOverNoise(const Eigen::Vector3d& point, const Eigen::Vector3d& normal,
                                         double albedo) const;

 private:
  [[nodiscard]] double radiance(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) const;

  OpticsConfig optics_;
  SE3 T_body_cam_;
  double contrast_;
  WaterAttenuation attenuation_;
  std::vector<Beam> beams_;
  double electrons_ = 0;  // of a white surface per unit of radiance
};

FeatureLight::FeatureLight(const OpticsConfig& optics, const SE3& T_body_cam, double contrast)
    : optics_(optics),
      T_body_cam_(T_body_cam),
      contrast_(contrast),
      attenuation_(optics.water),
      beams_(optics.strobes.begin(), optics.strobes.end()) {
  const Eigen::Vector3d axis = T_body_cam.rotation() * Eigen::Vector3d::UnitZ();
  const double reference =
      radiance(T_body_cam.translation() + optics.sensor.exposure_distance_m * axis, -axis);
  if (!(reference > 0))
    throw std::invalid_argument(
        "optics: no strobe lights the point at sensor.exposure_distance_m under the camera");
  electrons_ = optics.sensor.exposure * optics.sensor.full_well_electrons / reference;
}

double FeatureLight::radiance(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) const {
  const Channels& q = optics_.sensor.quantum_efficiency;
  const double range = (point - T_body_cam_.translation()).norm();
  double sum = 0;
  for (std::size_t s = 0; s < beams_.size(); ++s) {
    const StrobeConfig& strobe = optics_.strobes[s];
    const Eigen::Vector3d from = point - strobe.position_body;
    const double d = from.norm();
    const double cosine = std::max(0.0, -from.dot(normal) / d);
    const auto off_axis = static_cast<float>(from.dot(strobe.direction_body.normalized()) / d);
    const Radiance left = attenuation_(static_cast<float>(d + range));
    double mono = 0;
    for (std::size_t c = 0; c < 3; ++c) mono += q[c] * static_cast<double>(left[c]);
    sum += static_cast<double>(beams_[s](off_axis)) * cosine / (d * d) * mono / (q[0] + q[1] + q[2]);
  }
  return sum;
}

double FeatureLight::contrastOverNoise(const Eigen::Vector3d& point, const Eigen::Vector3d& normal,
                                       double albedo) const {
  const Eigen::Vector3d sight = (T_body_cam_.inverse() * point).normalized();
  const double vignetting = std::pow(std::max(sight.z(), 0.0), optics_.sensor.vignetting_power);
  const double electrons = std::min(electrons_ * albedo * vignetting * radiance(point, normal),
                                    optics_.sensor.full_well_electrons);
  const double read = optics_.sensor.read_noise_electrons;
  return contrast_ * electrons / std::sqrt(electrons + read * read);
}

}  // namespace

struct FeatureCamera::Impl {
  Impl(const SeaTerrain& t, const SimulatedFeatureConfig& c, const OpticsConfig& optics, const StereoRig& r,
       const SE3& body_cam, std::uint64_t seed)
      : terrain(t),
        config(c),
        rig(r),
        T_body_cam(body_cam),
        light(optics, body_cam, t.config().detail_contrast),
        errors(c.match_errors.empty() ? MatchErrors::shipped() : c.match_errors),
        smallest_px(c.smallest_size * r.left.width),
        landmarks(t.config(), c, static_cast<double>(r.left.width) * r.left.height, smallest_px) {
    Random random(seed, "shared-feature-errors");
    for (double& u : shared) u = random.gauss();
    for (int row = 0; row < kProbes; ++row)
      for (int column = 0; column < kProbes; ++column)
        probes.push_back(rig.left.ray({column * (rig.left.width - 1.0) / (kProbes - 1),
                                       row * (rig.left.height - 1.0) / (kProbes - 1)}));
    for (const Eigen::Vector3d& ray : probes) widest = std::max(widest, ray.head<2>().norm());
  }

  [[nodiscard]] std::optional<VisibleArea> visibleArea(const SE3& T_nav_cam) const;
  [[nodiscard]] bool mayBeVisible(const VisibleArea& area, const SE3& T_cam_nav,
                                  const Eigen::Vector2d& place) const;
  void observeLandmark(const Landmark& landmark, const SE3& T_nav_body, const SE3& T_nav_cam,
                       const SE3& T_cam_nav, std::uint64_t view_seed, std::vector<FoundFeature>& out) const;
  // Null for a pixel beyond the image or behind the camera; distorted.
  [[nodiscard]] std::optional<Eigen::Vector2d> pixelOf(const Camera& camera,
                                                       const Eigen::Vector3d& point) const;

  const SeaTerrain& terrain;
  SimulatedFeatureConfig config;
  StereoRig rig;
  SE3 T_body_cam;
  FeatureLight light;
  MatchErrors errors;
  double smallest_px;
  Landmarks landmarks;
  double shared[kShared];  // in their standard deviations
  std::vector<Eigen::Vector3d> probes;
  double widest = 0;  // tangent of the left camera's widest angle
};

std::optional<Eigen::Vector2d> FeatureCamera::Impl::pixelOf(const Camera& camera,
                                                            const Eigen::Vector3d& point) const {
  constexpr double kBeyond = 1.2;  // of the widest angle: farther out the lens model may fold back
  if (point.z() < kNearestPoint_m || point.head<2>().norm() > kBeyond * widest * point.z())
    return std::nullopt;
  const Eigen::Vector2d pixel = camera.project(point);
  if (!camera.contains(pixel, kBorder_px)) return std::nullopt;
  return pixel;
}

std::optional<VisibleArea> FeatureCamera::Impl::visibleArea(const SE3& T_nav_cam) const {
  VisibleArea area;
  area.nearest = std::numeric_limits<double>::infinity();
  Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& ray : probes) {
    const Eigen::Vector3d direction = (T_nav_cam.rotation() * ray).normalized();
    const auto distance = terrain.castRay(T_nav_cam.translation(), direction);
    if (!distance || *distance > static_cast<double>(kFarthest)) continue;
    const Eigen::Vector3d hit = T_nav_cam.translation() + *distance * direction;
    const double z = *distance / ray.norm();
    area.hits.emplace_back(hit.head<2>());
    area.nearest = std::min(area.nearest, z);
    area.farthest = std::max(area.farthest, z);
    const Eigen::Vector3d place(hit.x() - T_nav_cam.translation().x(), hit.y() - T_nav_cam.translation().y(),
                                1);
    h += place * place.transpose();
    b += hit.z() * place;
  }
  if (area.hits.size() < 4) return std::nullopt;
  area.plane = h.ldlt().solve(b);
  area.plane.z() -= area.plane.head<2>().dot(T_nav_cam.translation().head<2>());
  return area;
}

// Tests a place by the plane fitted to the visible area; relief moves its pixel by less than kRelief.
bool FeatureCamera::Impl::mayBeVisible(const VisibleArea& area, const SE3& T_cam_nav,
                                       const Eigen::Vector2d& place) const {
  constexpr double kRelief = 0.25;  // of the image's width
  const Eigen::Vector3d point =
      T_cam_nav * Eigen::Vector3d(place.x(), place.y(), area.plane.dot(place.homogeneous()));
  if (point.z() < kNearestPoint_m || point.head<2>().norm() > 2 * widest * point.z()) return false;
  const Eigen::Vector2d n = point.head<2>() / point.z();
  const Eigen::Vector2d pixel(rig.left.fx * n.x() + rig.left.cx, rig.left.fy * n.y() + rig.left.cy);
  return rig.left.contains(pixel, -kRelief * rig.left.width);
}

void FeatureCamera::Impl::observeLandmark(const Landmark& landmark, const SE3& T_nav_body,
                                          const SE3& T_nav_cam, const SE3& T_cam_nav, std::uint64_t view_seed,
                                          std::vector<FoundFeature>& out) const {
  NormalDeviates random(hash64(view_seed, 1), landmark.key);
  const double draw = random.uniform();
  if (draw >= landmark.detection) return;
  const SurfaceScene& scene = terrain.surface();
  const Eigen::Vector3d& origin = scene.origin();
  const auto local = [&](const Eigen::Vector3d& nav) {
    return Eigen::Vector3f((nav - origin).cast<float>());
  };

  Eigen::Vector3f above = local({landmark.north_east.x(), landmark.north_east.y(), terrain.lower().z()});
  above.z() -= kStart;
  const auto fall = scene.castRay(above, Eigen::Vector3f(0, 0, 1), std::numeric_limits<float>::max());
  if (!fall) return;
  const Eigen::Vector3d point =
      origin + Eigen::Vector3d(static_cast<double>(above.x()), static_cast<double>(above.y()),
                               static_cast<double>(above.z()) + static_cast<double>(*fall));

  const Eigen::Vector3d in_left = T_cam_nav * point, in_right = rig.T_right_left * in_left;
  const auto left = pixelOf(rig.left, in_left), right = pixelOf(rig.right, in_right);
  if (!left || !right) return;
  const double size_px = rig.left.fx * landmark.size / in_left.z();
  if (size_px < smallest_px || size_px >= kLargestSize * smallest_px) return;

  const Eigen::Vector3d sight = point - T_nav_cam.translation();
  const Eigen::Vector3f direction = sight.normalized().cast<float>();
  const auto hit = scene.firstHit(local(T_nav_cam.translation()), direction, kFarthest);
  if (!hit || static_cast<double>(hit->distance_m) < sight.norm() - kHidden) return;
  const Eigen::Vector3d right_eye = T_nav_cam * rig.T_right_left.inverse().translation();
  const Eigen::Vector3d right_sight = point - right_eye;
  if (scene.occluded(local(right_eye), right_sight.normalized().cast<float>(),
                     static_cast<float>(right_sight.norm() - kHidden)))
    return;

  const SurfacePoint surface =
      scene.look(hit->geometry, hit->primitive, hit->u, hit->v, static_cast<float>(landmark.size));
  Eigen::Vector3d normal = surface.normal.cast<double>();
  if (normal.dot(sight) > 0) normal = -normal;
  const double albedo = static_cast<double>(surface.albedo[0] + surface.albedo[1] + surface.albedo[2]) / 3;
  const SE3 T_body_nav = T_nav_body.inverse();
  const double contrast = light.contrastOverNoise(T_body_nav * point, T_body_nav.rotation() * normal, albedo);
  const double visible =
      contrast * contrast / (contrast * contrast + config.half_contrast * config.half_contrast);
  if (draw >= landmark.detection * visible) return;
  const double wider = 1 / std::sqrt(visible);

  // Errors common to both pixels, as tangents (equations: closure::SharedErrors).
  const Eigen::Vector2d n = in_left.head<2>() / in_left.z();
  const double width = rig.left.width;
  const double place_sigma = errors.statedPlace(size_px / width) * width * wider;
  const Eigen::Vector2d normal_place =
      std::sqrt(1 - config.place_shared_variance) * random.both() +
      std::sqrt(config.place_shared_variance) * smoothField(hash64(view_seed, 2), *left, width / kFieldCells);
  // Of normal deviates the length is below r with probability 1 - exp(-r^2 / 2): the table's length there.
  const Eigen::Vector2d place = place_sigma *
                                errors.placeRatio(1 - std::exp(-normal_place.squaredNorm() / 2)) *
                                normal_place.normalized();
  const Eigen::Vector2d drawn =
      config.shared_place * Eigen::Vector2d(shared[0], shared[1]) + config.shared_place_slope * shared[2] * n;
  const double disparity = config.shared_disparity_px * shared[3] +
                           config.shared_disparity_slope_px * (shared[4] * n.x() + shared[5] * n.y());
  // Some places match worse than others in every view.
  const double match_sigma =
      errors.statedMatch_px(GroundRandom(kMatchStream, landmark.key).uniform()) * wider;
  const auto match_error = [&] {
    const double u = 2 * random.uniform() - 1;
    return std::copysign(match_sigma * errors.matchRatio(std::abs(u)), u);
  };
  const double along = match_error();
  const Eigen::Vector2d match(along, match_error());
  const Eigen::Vector2d left_px = *left + place + rig.left.pixelJacobian(n) * drawn;
  const Eigen::Vector2d right_px = *right + place +
                                   rig.right.pixelJacobian(in_right.head<2>() / in_right.z()) * drawn +
                                   match - Eigen::Vector2d(disparity, 0);
  if (!rig.left.contains(left_px) || !rig.right.contains(right_px)) return;

  StereoFeature f;
  f.left = left_px.cast<float>();
  f.right = right_px.cast<float>();
  f.size = static_cast<float>(size_px);
  f.place_sigma = static_cast<float>(place_sigma);
  f.match_sigma = static_cast<float>(match_sigma);
  for (std::size_t k = 0; k < 3; ++k) f.colour[k] = srgbFromLinear(surface.albedo[k]);
  const auto noise = static_cast<float>(
      std::min(kMaxDescriptorNoise, config.descriptor_noise * wider * std::exp(kDescriptorTail * random())));
  out.push_back({f, point, landmark.key, landmark.appearance, kNoiseStep * std::round(noise / kNoiseStep),
                 landmark.detection * visible});
}

FeatureCamera::FeatureCamera(const SeaTerrain& terrain, const SimulatedFeatureConfig& config,
                             const OpticsConfig& optics, const StereoRig& rig, const SE3& T_body_cam,
                             std::uint64_t seed)
    : impl_(std::make_unique<Impl>(terrain, config, optics, rig, T_body_cam, seed)) {}

FeatureCamera::~FeatureCamera() = default;

FeatureCamera::Observation FeatureCamera::observe(const SE3& T_nav_body, std::uint64_t view_seed) const {
  const Impl& m = *impl_;
  Observation seen;
  seen.frame.width = m.rig.left.width;
  seen.frame.height = m.rig.left.height;
  const SE3 T_nav_cam = T_nav_body * m.T_body_cam, T_cam_nav = T_nav_cam.inverse();
  const auto area = m.visibleArea(T_nav_cam);
  if (!area) return seen;
  std::vector<FoundFeature> found;
  constexpr double kRelief = 1.3;  // depths between the probes differ by less than this factor
  m.landmarks.visit(area->hits, m.smallest_px * area->nearest / m.rig.left.fx / kRelief,
                    kLargestSize * m.smallest_px * area->farthest / m.rig.left.fx * kRelief,
                    [&](const Landmark& landmark) {
                      if (m.mayBeVisible(*area, T_cam_nav, landmark.north_east))
                        m.observeLandmark(landmark, T_nav_body, T_nav_cam, T_cam_nav, view_seed, found);
                    });
  std::sort(found.begin(), found.end(), [](const FoundFeature& a, const FoundFeature& b) {
    return a.strength != b.strength ? a.strength > b.strength : a.key < b.key;
  });
  const std::uint64_t descriptor_seed = hash64(view_seed, 3);
  for (FoundFeature& s : found) {
    s.feature.descriptor = simulatedDescriptor(s.appearance, descriptor_seed, seen.keys.size(), s.noise);
    seen.frame.features.push_back(s.feature);
    seen.points.push_back(s.point);
    seen.keys.push_back(s.key);
    seen.appearances.push_back(s.appearance);
  }
  return seen;
}

}  // namespace fathom::sim

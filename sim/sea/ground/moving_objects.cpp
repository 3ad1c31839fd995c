#include "sim/sea/ground/moving_objects.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "sim/sea/ground/noise.hpp"
#include "sim/sea/ground/shapes.hpp"

namespace fathom::sim {
namespace {

constexpr double kSwellPeriod = 7.0;  // [s]

}  // namespace

MovingObjects::MovingObjects(const TerrainConfig& config, const SurfaceScene& bed) : bed_(bed) {
  const Eigen::Vector3d low = bed.lower() - bed.origin(), high = bed.upper() - bed.origin();
  for (int i = 0; i < config.fish; ++i) {
    GroundRandom random(hash64(config.seed, 400), static_cast<std::uint64_t>(i));
    fish_.push_back({.length_m = random.uniform(0.12, 0.45),
                     .speed_mps = random.uniform(0.15, 0.7),
                     .circuit_m = random.uniform(1.0, 4.0),
                     .phase = random.uniform(0, 2 * std::numbers::pi),
                     .height_m = random.uniform(0.3, 1.1),
                     .centre = {random.uniform(low.x(), high.x()), random.uniform(low.y(), high.y())}});
  }
  const auto tufts = static_cast<std::uint64_t>(
      std::lround(config.swaying_density_per_m2 * (high.x() - low.x()) * (high.y() - low.y())));
  const FractalNoise meadow{hash64(config.seed, 401), 2.5, 3, 0.5};
  for (std::uint64_t i = 0; i < tufts; ++i) {
    GroundRandom random(hash64(config.seed, 402), i);
    const double north = random.uniform(low.x(), high.x()), east = random.uniform(low.y(), high.y());
    if (meadow(north, east) < random.uniform(-1.5, 1.0)) continue;
    const double length = random.uniform(0.12, 0.35);
    constexpr int kBladesPerTuft = 7;
    for (int k = 0; k < kBladesPerTuft; ++k) {
      const double n = north + random.uniform(-0.04, 0.04), e = east + random.uniform(-0.04, 0.04);
      const auto depth = bed.depthAt(static_cast<float>(n), static_cast<float>(e));
      if (!depth) continue;
      blades_.push_back({.root = {static_cast<float>(n), static_cast<float>(e), *depth},
                         .length_m = static_cast<float>(length * random.uniform(0.6, 1.1)),
                         .width_m = static_cast<float>(random.uniform(0.008, 0.02)),
                         .tilt_rad = static_cast<float>(random.uniform(0.1, 0.9)),
                         .turn_rad = static_cast<float>(random.uniform(0, 2 * std::numbers::pi)),
                         .tone = static_cast<float>(random.uniform(0.7, 1.3))});
    }
  }
}

Eigen::Vector2d MovingObjects::placeOf(const Fish& fish, double time_s) {
  const double a = fish.phase + fish.speed_mps / fish.circuit_m * time_s;
  return fish.centre + fish.circuit_m * Eigen::Vector2d(std::cos(a), std::sin(a));
}

TriangleSurface MovingObjects::fishAt(const Fish& fish, const Eigen::Vector2d& place, double time_s) const {
  // Along x from nose to tail, flat to its sides: a spindle, then a tail fin.
  constexpr int kRings = 17, kAround = 12;
  constexpr double kTailStart = 0.82;  // of its length
  TriangleSurface body;
  const double beat = 2 * std::numbers::pi * (0.8 + fish.speed_mps / fish.length_m) * time_s + fish.phase;
  for (int ring = 0; ring < kRings; ++ring) {
    const double s = static_cast<double>(ring) / (kRings - 1);
    const double spindle =
        s < kTailStart ? std::sin(std::numbers::pi * std::pow(s / (kTailStart + 0.06), 0.65)) : 0.0;
    const double fin = s < kTailStart ? 0.0 : 0.13 * (s - kTailStart) / (1 - kTailStart) + 0.02;
    const double half_width = fish.length_m * (0.075 * spindle + 0.004);
    const double half_height = fish.length_m * (0.15 * spindle + fin + 0.004);
    const double bend = 0.09 * fish.length_m * s * s * std::sin(beat - 4 * s);
    for (int k = 0; k < kAround; ++k) {
      const double a = 2 * std::numbers::pi * k / kAround;
      body.vertices.emplace_back(static_cast<float>(fish.length_m * (0.5 - s)),
                                 static_cast<float>(bend + half_width * std::sin(a)),
                                 static_cast<float>(-half_height * std::cos(a)));
      const double belly = 0.5 - 0.5 * std::cos(a);  // dark above, pale below
      const double bar = 0.75 + 0.25 * std::sin(38 * s);
      body.covers.push_back({srgbFromLinear(bar * (Eigen::Vector3d(0.10, 0.12, 0.13) +
                                                   belly * Eigen::Vector3d(0.45, 0.45, 0.42))),
                             0});
    }
  }
  for (std::uint32_t ring = 0; ring + 1 < kRings; ++ring) {
    for (std::uint32_t k = 0; k < kAround; ++k) {
      const std::uint32_t a = ring * kAround + k, b = ring * kAround + (k + 1) % kAround;
      body.triangles.push_back({a, a + kAround, b});
      body.triangles.push_back({b, a + kAround, b + kAround});
    }
  }
  computeSurfaceNormals(body);
  const double heading = fish.phase + fish.speed_mps / fish.circuit_m * time_s + std::numbers::pi / 2;
  const auto depth = bed_.depthAt(static_cast<float>(place.x()), static_cast<float>(place.y()));
  const double z = depth ? *depth - fish.height_m : -fish.height_m;
  const Eigen::Matrix3d rotation = Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  sim::place(body, rotation.cast<float>(), Eigen::Vector3d(place.x(), place.y(), z).cast<float>());
  return body;
}

TriangleSurface MovingObjects::bladeAt(const Blade& blade, double time_s) {
  constexpr std::uint32_t kSegments = 7;
  TriangleSurface ribbon;
  // The swell travels: neighbouring blades sway nearly in phase.
  const double sway = 0.55 * std::sin(2 * std::numbers::pi * time_s / kSwellPeriod + 0.6 * blade.root.x() +
                                      0.3 * blade.root.y());
  const Eigen::Vector3f tilt(std::cos(blade.turn_rad), std::sin(blade.turn_rad), 0);
  const Eigen::Vector3f side = tilt.cross(Eigen::Vector3f::UnitZ());
  Eigen::Vector3f p = blade.root;
  for (std::uint32_t i = 0; i <= kSegments; ++i) {
    const float s = static_cast<float>(i) / kSegments;
    const float width = blade.width_m * (1.0F - 0.8F * s * s);
    ribbon.vertices.push_back(p + 0.5F * width * side);
    ribbon.vertices.push_back(p - 0.5F * width * side);
    const Cover cover{srgbFromLinear((0.6 + 0.6 * s) * blade.tone * Eigen::Vector3d(0.10, 0.15, 0.045)), 60};
    ribbon.covers.insert(ribbon.covers.end(), 2, cover);
    Eigen::Vector3f direction = Eigen::Vector3f(0, 0, -1) + s * std::tan(blade.tilt_rad) * tilt +
                                s * static_cast<float>(sway) * Eigen::Vector3f(1, 0, 0);
    p += blade.length_m / kSegments * direction.normalized();
    if (i == kSegments) break;
    const std::uint32_t v = 2 * i;
    ribbon.triangles.push_back({v, v + 1, v + 2});
    ribbon.triangles.push_back({v + 2, v + 1, v + 3});
  }
  computeSurfaceNormals(ribbon);
  return ribbon;
}

std::unique_ptr<SurfaceScene> MovingObjects::near(const Eigen::Vector3f& centre, float radius_m,
                                                  double time_s) const {
  TriangleSurface all;
  for (const Fish& fish : fish_) {
    const Eigen::Vector2d place = placeOf(fish, time_s);
    if ((place - centre.head<2>().cast<double>()).norm() < static_cast<double>(radius_m))
      all.append(fishAt(fish, place, time_s));
  }
  for (const Blade& blade : blades_)
    if ((blade.root.head<2>() - centre.head<2>()).norm() < radius_m) all.append(bladeAt(blade, time_s));
  if (all.triangles.empty()) return nullptr;
  auto scene = std::make_unique<SurfaceScene>(bed_.origin());
  scene->add(std::move(all));
  scene->commit();
  return scene;
}

}  // namespace fathom::sim

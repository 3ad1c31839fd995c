#include "sim/sea/ground/seafloor.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "sim/sea/ground/bed.hpp"
#include "sim/sea/ground/noise.hpp"
#include "sim/sea/ground/random.hpp"
#include "sim/sea/ground/shapes.hpp"

namespace fathom::sim {
namespace {

constexpr double kStoneEdge = 0.012;    // [m], of the triangles of stones
constexpr double kCoralEdge = 0.008;    // [m], of those of coral heads, whose outlines are knobbly
constexpr double kEdgeOfGrid = 0.4;     // least edge of both, by the bed's grid spacing: wide terrains fit
constexpr float kCastHeight = 1000.0F;  // [m] above everything

// One kind of thing that lies scattered on the bed.
struct Scatter {
  std::uint64_t stream;  // of random numbers
  double density_per_m2, min_size_m, max_size_m;
  double size_exponent;  // density of sizes ~ size^-exponent: small ones are many
  double patchiness;
  double tilt_rad;  // largest, from the bed's own slope
  std::function<TriangleSurface(std::uint64_t seed, double size_m)> make;
  double sink_min, sink_max;  // depth of its centre below the bed, of its size
};

// Inverse of the cumulative distribution of a power law between min and max.
double powerLaw(double u, double low, double high, double exponent) {
  const double k = 1.0 - exponent;
  return std::pow(std::pow(low, k) + u * (std::pow(high, k) - std::pow(low, k)), 1.0 / k);
}

// Removes triangles that the bed hides: no ray can reach them, and no map can be asked for them.
void dropBuried(TriangleSurface& thing, const SurfaceScene& bed, float depth_m) {
  std::vector<bool> buried(thing.vertices.size());
  for (std::size_t i = 0; i < buried.size(); ++i)
    buried[i] = bed.occluded(thing.vertices[i], Eigen::Vector3f(0, 0, -1), depth_m);
  std::erase_if(thing.triangles, [&](const auto& t) { return buried[t[0]] && buried[t[1]] && buried[t[2]]; });
}

// Where a thing that sinks in by `sink_m` stands on the bed; nothing beyond its edge.
std::optional<Eigen::Vector3f> footOn(const SurfaceScene& bed, double north, double east, double sink_m) {
  Eigen::Vector3f above = (Eigen::Vector3d(north, east, 0) - bed.origin()).cast<float>();
  above.z() = -kCastHeight;
  const std::optional<float> fall = bed.castRay(above, Eigen::Vector3f(0, 0, 1), 2 * kCastHeight);
  if (!fall) return std::nullopt;
  return Eigen::Vector3f(above.x(), above.y(), above.z() + *fall + static_cast<float>(sink_m));
}

TriangleSurface scatter(const TerrainConfig& config, const Scatter& kind, const SurfaceScene& bed) {
  const double area = config.size_north_m * config.size_east_m;
  const auto count = static_cast<std::size_t>(std::lround(kind.density_per_m2 * area));
  const FractalNoise patches{hash64(config.seed, kind.stream + 1), 3.0, 3, 0.5};
  std::vector<TriangleSurface> things(count);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    ThingRandom random(hash64(config.seed, kind.stream), i);
    double north = 0, east = 0;
    // Tries places until the patch takes one; patches change where things are, not how many.
    constexpr int kTries = 12;
    for (int attempt = 0; attempt < kTries; ++attempt) {
      north = config.centre_north_m + (random.uniform() - 0.5) * config.size_north_m;
      east = config.centre_east_m + (random.uniform() - 0.5) * config.size_east_m;
      const double level = std::clamp(0.5 + 0.8 * patches(north, east), 0.0, 1.0);
      if (random.uniform() < 1.0 - kind.patchiness + kind.patchiness * level * level * level) break;
    }
    const double size = powerLaw(random.uniform(), kind.min_size_m, kind.max_size_m, kind.size_exponent);
    const double sink = size * random.uniform(kind.sink_min, kind.sink_max);
    const auto foot = footOn(bed, north, east, sink);
    if (!foot) return;
    const double turn = random.uniform(0, 2 * std::numbers::pi), lean = random.uniform(0, kind.tilt_rad),
                 lean_to = random.uniform(0, 2 * std::numbers::pi);
    const Eigen::Vector3d lean_axis(std::cos(lean_to), std::sin(lean_to), 0);
    const Eigen::Matrix3d rotation = Eigen::AngleAxisd(lean, lean_axis).toRotationMatrix() *
                                     Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    things[i] = kind.make(random.bits(), size);
    place(things[i], rotation.cast<float>(), *foot);
    dropBuried(things[i], bed, static_cast<float>(size));
  });
  TriangleSurface all;
  for (const TriangleSurface& thing : things) all.append(thing);
  return all;
}

TriangleSurface placed(const TerrainConfig& config, const SurfaceScene& bed) {
  TriangleSurface all;
  for (const PlacedConfig& p : config.placed) {
    const auto foot = footOn(bed, p.north_m, p.east_m, 0);
    if (!foot) continue;
    TriangleSurface thing = p.coral ? makeCoralHead(p.seed, p.size_m, config.corals.overhang, kCoralEdge)
                                    : makeStone(p.seed, p.size_m, kStoneEdge);
    place(thing,
          Eigen::AngleAxisf(static_cast<float>(p.heading_rad), Eigen::Vector3f::UnitZ()).toRotationMatrix(),
          *foot);
    dropBuried(thing, bed, static_cast<float>(p.size_m));
    all.append(thing);
  }
  return all;
}

}  // namespace

void buildSeafloor(const TerrainConfig& config, SurfaceScene& scene) {
  scene.add(makeBed(config, scene.origin()));
  scene.commit();
  const double coarse = kEdgeOfGrid * config.grid_spacing_m;
  const auto stone = [&](std::uint64_t seed, double size) {
    return makeStone(seed, size, std::max(kStoneEdge, coarse));
  };
  const auto coral = [&](std::uint64_t seed, double size) {
    return makeCoralHead(seed, size, config.corals.overhang, std::max(kCoralEdge, coarse));
  };
  const RubbleConfig& rubble = config.rubble;
  const BoulderConfig& boulders = config.boulders;
  const CoralConfig& corals = config.corals;
  const Scatter kinds[] = {
      {100, rubble.density_per_m2, rubble.min_size_m, rubble.max_size_m, 2.2, rubble.patchiness, 0.9, stone,
       -0.15, 0.1},
      {200, boulders.density_per_m2, boulders.min_size_m, boulders.max_size_m, 1.8, 0.4, 0.5, stone, -0.1,
       0.12},
      {300, corals.density_per_m2, corals.min_size_m, corals.max_size_m, 1.5, 0.6, 0.2, coral, 0.0, 0.05},
  };
  // All kinds lie on the bed alone, so none rests in the air on another; they may run into each other.
  std::vector<TriangleSurface> things;
  for (const Scatter& kind : kinds) things.push_back(scatter(config, kind, scene));
  things.push_back(placed(config, scene));
  for (TriangleSurface& thing : things) scene.add(std::move(thing));
  scene.commit();
}

}  // namespace fathom::sim

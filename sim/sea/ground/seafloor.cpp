#include "sim/sea/ground/seafloor.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>

#include "sim/sea/ground/noise.hpp"
#include "sim/sea/ground/relief_raster.hpp"
#include "sim/sea/ground/shapes.hpp"

namespace fathom::sim {
namespace {

// Horizontal length of the undisturbed bed that becomes the wall: about the wall's height, which keeps the
// size of the cells.
double wallLength(const LedgeConfig& ledge) {
  return std::max(1.3 * ledge.drop_m, ledge.width_m);
}

struct BedPoint {
  Eigen::Vector3d position;
  double ripple = 0.5;     // height of the sand wave over its trough, 0 to 1
  double rockiness = 0.0;  // 0 sand, 1 bare rock
};

class BedShape {
 public:
  explicit BedShape(const TerrainConfig& config)
      : config_(config),
        broad_{hash64(config.seed, 10), config.undulation_wavelength_m, 3, 0.45},
        meander_{hash64(config.seed, 11), 1.7, 2, 0.5},
        ripple_field_{hash64(config.seed, 12), 4.0, 2, 0.5},
        ledge_line_{hash64(config.seed, 13), 3.5, 3, 0.5},
        rough_{hash64(config.seed, 14), 0.45, 3, 0.6},
        crags_{hash64(config.seed, 15), 1.1, 4, 0.55},
        mats_{hash64(config.seed, 16), 1.6, 4, 0.6},
        tone_{hash64(config.seed, 17), 0.6, 4, 0.65} {
    if (!config.relief_file.empty()) captured_.emplace(config.relief_file, config.relief_cell_m);
  }

  // A bed point before its fine relief, from the undisturbed horizontal place.
  BedPoint smooth(double north, double east) const {
    BedPoint bed{{north, east, config_.base_depth_m + config_.undulation_m * broad_(north, east)}};
    if (captured_)
      bed.position.z() += captured_->depthAt(north - config_.centre_north_m, east - config_.centre_east_m);
    const RippleConfig& r = config_.ripples;
    if (r.height_m > 0) {
      const double along = north * std::cos(r.direction_rad) + east * std::sin(r.direction_rad);
      const double phase =
          2 * std::numbers::pi * along / r.wavelength_m + 1.9 * r.meander * meander_(north, east);
      const double strength = 1 - r.meander * (1 - smoothstep(-1.2, 0.4, ripple_field_(north, east)));
      const double wave = std::sin(phase) + 0.22 * std::sin(2 * phase + 0.9);  // steeper on the lee side
      bed.position.z() -= 0.45 * r.height_m * strength * wave;
      bed.ripple = 0.5 + 0.45 * strength * wave;
    }
    for (std::size_t i = 0; i < config_.ledges.size(); ++i) fall(config_.ledges[i], i, north, east, bed);
    return bed;
  }

  // Relief along the normal; walls are rougher.
  double relief(const Eigen::Vector3d& p, double rock) const {
    return config_.roughness_m * rough_(p) + rock * 0.07 * crags_(p);
  }

  Cover cover(const Eigen::Vector3d& p, double ripple, double rockiness) const {
    static const Eigen::Vector3d kSand(0.40, 0.36, 0.28), kDarkSand(0.25, 0.225, 0.17),
        kMat(0.11, 0.12, 0.065), kRock(0.24, 0.20, 0.16), kCrust(0.33, 0.19, 0.19);
    const double tone = tone_(p), mat = mats_(p);
    const double trough = smoothstep(0.45, 0.1, ripple);  // dark debris gathers in troughs
    Eigen::Vector3d colour = kSand + (0.65 * trough) * (kDarkSand - kSand);
    const double matted = smoothstep(0.8, 1.5, mat);
    colour += 0.85 * matted * (kMat - colour);
    const Eigen::Vector3d rock = kRock + smoothstep(0.1, 1.0, mat) * (kCrust - kRock);
    colour += rockiness * (rock - colour);
    colour *= std::max(0.4, 1.0 + (0.10 + 0.18 * rockiness) * tone);
    return {srgbFromLinear(colour),
            static_cast<std::uint8_t>(std::lround(255 * std::max(rockiness, 0.5 * matted)))};
  }

 private:
  void fall(const LedgeConfig& ledge, std::size_t index, double north, double east, BedPoint& bed) const {
    const double c = std::cos(ledge.heading_rad), s = std::sin(ledge.heading_rad);
    const double dn = north - ledge.north_m, de = east - ledge.east_m;
    const double across = -s * dn + c * de;
    const double wander = 0.45 * ledge_line_(across, 17.0 * static_cast<double>(index));
    const double length = wallLength(ledge);
    const double t = std::clamp((c * dn + s * de + wander) / length, 0.0, 1.0);
    if (t <= 0) return;
    // The lip overhangs the wall, which recedes below it.
    const double out = ledge.width_m * t + 0.5 * ledge.undercut_m * std::sin(2 * std::numbers::pi * t);
    const double shift = out - length * t;
    bed.position += Eigen::Vector3d(c * shift, s * shift, ledge.drop_m * smoothstep(0.0, 1.0, t));
    // The wall is bare rock.
    bed.rockiness = std::max(bed.rockiness, smoothstep(0.0, 0.15, t) * smoothstep(1.0, 0.8, t));
  }

  const TerrainConfig& config_;
  FractalNoise broad_, meander_, ripple_field_, ledge_line_, rough_, crags_, mats_, tone_;
  std::optional<ReliefRaster> captured_;
};

void computeGridNormals(GridSurface& grid) {
  const auto at = [&](int row, int column) -> const Eigen::Vector3f& {
    return grid.vertices[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
                         static_cast<std::size_t>(column)];
  };
  oneapi::tbb::parallel_for(0, grid.rows, [&](int r) {
    for (int c = 0; c < grid.columns; ++c) {
      const Eigen::Vector3f north = at(std::min(r + 1, grid.rows - 1), c) - at(std::max(r - 1, 0), c);
      const Eigen::Vector3f east = at(r, std::min(c + 1, grid.columns - 1)) - at(r, std::max(c - 1, 0));
      const Eigen::Vector3f normal = east.cross(north);
      const float length = normal.norm();
      grid.normals[static_cast<std::size_t>(r) * static_cast<std::size_t>(grid.columns) +
                   static_cast<std::size_t>(c)] =
          length > 0 ? Eigen::Vector3f(normal / length) : Eigen::Vector3f(0, 0, -1);
    }
  });
}

// The bed of the procedural seafloor, in the frame of `origin_nav`. A ledge moves vertices sideways as well
// as down, so its wall is as finely sampled as the flats and may overhang.
GridSurface makeBed(const TerrainConfig& config, const Eigen::Vector3d& origin_nav) {
  const BedShape shape(config);
  // Ledges shift the bed beyond them towards themselves: the grid is larger by that margin.
  double margin = 0.0;
  for (const LedgeConfig& ledge : config.ledges)
    margin += wallLength(ledge) - ledge.width_m + ledge.undercut_m;
  GridSurface bed;
  bed.rows = static_cast<int>(std::ceil((config.size_north_m + 2 * margin) / config.grid_spacing_m)) + 1;
  bed.columns = static_cast<int>(std::ceil((config.size_east_m + 2 * margin) / config.grid_spacing_m)) + 1;
  const std::size_t columns = static_cast<std::size_t>(bed.columns);
  const std::size_t count = static_cast<std::size_t>(bed.rows) * columns;
  bed.vertices.resize(count);
  bed.normals.resize(count);
  bed.covers.resize(count);
  std::vector<float> ripples(count), rockiness(count);
  const double north0 = config.centre_north_m - 0.5 * (bed.rows - 1) * config.grid_spacing_m;
  const double east0 = config.centre_east_m - 0.5 * (bed.columns - 1) * config.grid_spacing_m;
  oneapi::tbb::parallel_for(0, bed.rows, [&](int r) {
    for (std::size_t c = 0; c < columns; ++c) {
      const std::size_t i = static_cast<std::size_t>(r) * columns + c;
      const BedPoint point = shape.smooth(north0 + r * config.grid_spacing_m,
                                          east0 + static_cast<double>(c) * config.grid_spacing_m);
      bed.vertices[i] = (point.position - origin_nav).cast<float>();
      ripples[i] = static_cast<float>(point.ripple);
      rockiness[i] = static_cast<float>(point.rockiness);
    }
  });
  computeGridNormals(bed);
  oneapi::tbb::parallel_for(0, bed.rows, [&](int r) {
    for (std::size_t c = 0; c < columns; ++c) {
      const std::size_t i = static_cast<std::size_t>(r) * columns + c;
      const Eigen::Vector3d p = bed.vertices[i].cast<double>() + origin_nav;
      bed.covers[i] = shape.cover(p, ripples[i], rockiness[i]);
      bed.vertices[i] += static_cast<float>(shape.relief(p, rockiness[i])) * bed.normals[i];
    }
  });
  computeGridNormals(bed);
  return bed;
}

constexpr double kStoneEdge = 0.012;  // [m], of the triangles of stones
constexpr double kCoralEdge = 0.008;  // [m], of those of coral heads, with knobbly outlines
constexpr double kEdgeOfGrid = 0.4;   // least edge of both, by the bed's grid spacing: wide terrains fit

// One kind of object scattered on the bed.
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

// Removes triangles below the bed, which no ray can reach.
void dropBuried(TriangleSurface& object, const SurfaceScene& bed, float depth_m) {
  std::vector<bool> buried(object.vertices.size());
  for (std::size_t i = 0; i < buried.size(); ++i)
    buried[i] = bed.occluded(object.vertices[i], Eigen::Vector3f(0, 0, -1), depth_m);
  std::erase_if(object.triangles,
                [&](const auto& t) { return buried[t[0]] && buried[t[1]] && buried[t[2]]; });
}

// Place on the bed of an object that sinks in by `sink_m`, local frame; none beyond the bed's edge.
std::optional<Eigen::Vector3f> footOn(const SurfaceScene& bed, double north, double east, double sink_m) {
  const Eigen::Vector2f place = (Eigen::Vector2d(north, east) - bed.origin().head<2>()).cast<float>();
  const std::optional<float> depth = bed.depthAt(place.x(), place.y());
  if (!depth) return std::nullopt;
  return Eigen::Vector3f(place.x(), place.y(), *depth + static_cast<float>(sink_m));
}

TriangleSurface scatter(const TerrainConfig& config, const Scatter& kind, const SurfaceScene& bed) {
  const double area = config.size_north_m * config.size_east_m;
  const auto count = static_cast<std::size_t>(std::lround(kind.density_per_m2 * area));
  const FractalNoise patches{hash64(config.seed, kind.stream + 1), 3.0, 3, 0.5};
  std::vector<TriangleSurface> objects(count);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    GroundRandom random(hash64(config.seed, kind.stream), i);
    double north = 0, east = 0;
    // Draws places until a patch accepts one; patches change the places of objects, not their number.
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
    const double turn = random.uniform(0, 2 * std::numbers::pi), tilt = random.uniform(0, kind.tilt_rad),
                 tilt_heading = random.uniform(0, 2 * std::numbers::pi);
    const Eigen::Vector3d tilt_axis(std::cos(tilt_heading), std::sin(tilt_heading), 0);
    const Eigen::Matrix3d rotation = Eigen::AngleAxisd(tilt, tilt_axis).toRotationMatrix() *
                                     Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    objects[i] = kind.make(random.bits(), size);
    place(objects[i], rotation.cast<float>(), *foot);
    dropBuried(objects[i], bed, static_cast<float>(size));
  });
  TriangleSurface all;
  for (const TriangleSurface& object : objects) all.append(object);
  return all;
}

TriangleSurface placed(const TerrainConfig& config, const SurfaceScene& bed) {
  TriangleSurface all;
  for (const PlacedConfig& p : config.placed) {
    const auto foot = footOn(bed, p.north_m, p.east_m, 0);
    if (!foot) continue;
    TriangleSurface object = p.coral ? makeCoralHead(p.seed, p.size_m, config.corals.overhang, kCoralEdge)
                                     : makeStone(p.seed, p.size_m, kStoneEdge);
    place(object,
          Eigen::AngleAxisf(static_cast<float>(p.heading_rad), Eigen::Vector3f::UnitZ()).toRotationMatrix(),
          *foot);
    dropBuried(object, bed, static_cast<float>(p.size_m));
    all.append(object);
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
  // All kinds are placed on the bed alone; they may intersect.
  std::vector<TriangleSurface> objects;
  for (const Scatter& kind : kinds) objects.push_back(scatter(config, kind, scene));
  objects.push_back(placed(config, scene));
  for (TriangleSurface& object : objects) scene.add(std::move(object));
  scene.commit();
}

}  // namespace fathom::sim

#include "sim/sea/ground/bed.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/sea/ground/noise.hpp"
#include "sim/sea/ground/random.hpp"

namespace fathom::sim {
namespace {

double smoothstep(double low, double high, double x) {
  const double t = std::clamp((x - low) / (high - low), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

// Horizontal length of the undisturbed bed that becomes the wall: about the wall's height, so cells keep
// their size.
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
        tone_{hash64(config.seed, 17), 0.6, 4, 0.65} {}

  // A bed point before its fine relief, from the undisturbed horizontal place.
  BedPoint smooth(double north, double east) const {
    BedPoint bed{{north, east, config_.base_depth_m + config_.undulation_m * broad_(north, east)}};
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
    return {{srgbFromLinear(colour.x()), srgbFromLinear(colour.y()), srgbFromLinear(colour.z())},
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
    // The lip leans out over the wall, which recedes below it.
    const double out = ledge.width_m * t + 0.5 * ledge.undercut_m * std::sin(2 * std::numbers::pi * t);
    const double shift = out - length * t;
    bed.position += Eigen::Vector3d(c * shift, s * shift, ledge.drop_m * smoothstep(0.0, 1.0, t));
    // Sand does not lie on the wall: there the rock shows.
    bed.rockiness = std::max(bed.rockiness, smoothstep(0.0, 0.15, t) * smoothstep(1.0, 0.8, t));
  }

  const TerrainConfig& config_;
  FractalNoise broad_, meander_, ripple_field_, ledge_line_, rough_, crags_, mats_, tone_;
};

// Calls work(row) for all rows on the threads of the caller's arena.
template <typename Work>
void forRows(int rows, const Work& work) {
  oneapi::tbb::parallel_for(0, rows, work);
}

void computeGridNormals(GridSurface& grid) {
  const auto at = [&](int row, int column) -> const Eigen::Vector3f& {
    return grid.vertices[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
                         static_cast<std::size_t>(column)];
  };
  forRows(grid.rows, [&](int r) {
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

}  // namespace

GridSurface makeBed(const TerrainConfig& config, const Eigen::Vector3d& origin_nav) {
  const BedShape shape(config);
  // Ledges pull the bed beyond them towards themselves: lay out as much more.
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
  forRows(bed.rows, [&](int r) {
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
  forRows(bed.rows, [&](int r) {
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

}  // namespace fathom::sim

#include "sim/features/landmarks.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/sea/ground/random.hpp"

namespace fathom::sim {
namespace {

constexpr double kOctaveSize = 0.01;  // smallest of octave 0 [m]
constexpr int kOctaves = 2;           // that a view shows

double sizeOfLevel(int level) {
  return std::ldexp(kOctaveSize, level);
}

std::uint64_t mixed(std::uint64_t seed, std::int64_t level, std::int64_t u, std::int64_t v) {
  return hash64(hash64(hash64(seed, static_cast<std::uint64_t>(level)), static_cast<std::uint64_t>(u)),
                static_cast<std::uint64_t>(v));
}

std::int64_t wrapped(std::int64_t cell, std::int64_t cells) {
  return cells > 0 ? ((cell % cells) + cells) % cells : cell;
}

}  // namespace

Landmarks::Landmarks(const TerrainConfig& terrain, const FeatureConfig& config, double view_px,
                     double smallest_px)
    : config_(config) {
  // Cells of kOctaves octaves in a view: view / cell^2 (1 + 1/4 + ...).
  double octaves = 0;
  for (int k = 0; k < kOctaves; ++k) octaves += std::ldexp(1.0, -2 * k);
  cell_per_size_ = std::sqrt(octaves * view_px / config.landmarks_per_view) / smallest_px;

  Lattice ground;
  ground.seed = hash64(terrain.seed, 700);
  ground.share = 1 - config.alike_share;
  if (ground.share > 0) grounds_.push_back(ground);
  if (config.alike_share > 0) {
    Lattice ripples;
    ripples.seed = hash64(terrain.seed, 701);
    ripples.heading = terrain.ripples.direction_rad;
    ripples.period = {terrain.ripples.wavelength_m, config.alike_along_m};
    ripples.share = config.alike_share;
    grounds_.push_back(ripples);
  }
  for (const PlacedConfig& thing : terrain.placed) {
    Lattice own;
    own.seed = hash64(thing.seed, 702);
    own.origin = {thing.north_m, thing.east_m};
    own.heading = thing.heading_rad;
    own.radius = 0.5 * thing.size_m;
    own.copy = things_.size() + 1;
    things_.push_back(own);
  }
}

bool Landmarks::onThing(const Eigen::Vector2d& north_east) const {
  return std::any_of(things_.begin(), things_.end(), [&](const Lattice& thing) {
    return (north_east - thing.origin).squaredNorm() < thing.radius * thing.radius;
  });
}

void Landmarks::visit(const std::vector<Eigen::Vector2d>& corners, double smallest, double largest,
                      const Visitor& visitor) const {
  if (corners.empty() || !(smallest > 0) || !(largest >= smallest)) return;
  const int first = static_cast<int>(std::floor(std::log2(smallest / kOctaveSize)));
  const int last = static_cast<int>(std::floor(std::log2(largest / kOctaveSize)));
  for (int level = first; level <= last; ++level) {
    for (const Lattice& lattice : grounds_)
      visitLevel(lattice, level, corners, smallest, largest, [&](const Landmark& landmark) {
        if (!onThing(landmark.north_east)) visitor(landmark);
      });
    for (const Lattice& lattice : things_) visitLevel(lattice, level, corners, smallest, largest, visitor);
  }
}

void Landmarks::visitLevel(const Lattice& lattice, int level, const std::vector<Eigen::Vector2d>& corners,
                           double smallest, double largest, const Visitor& visitor) const {
  const double c = std::cos(lattice.heading), s = std::sin(lattice.heading);
  Eigen::Array2d low = Eigen::Array2d::Constant(1e9), high = -low;
  for (const Eigen::Vector2d& corner : corners) {
    const Eigen::Vector2d d = corner - lattice.origin;
    const Eigen::Array2d at(c * d.x() + s * d.y(), -s * d.x() + c * d.y());
    low = low.min(at);
    high = high.max(at);
  }
  if (lattice.radius > 0) {
    low = low.max(-lattice.radius);
    high = high.min(lattice.radius);
  }
  if ((low > high).any()) return;

  const double edge = cell_per_size_ * sizeOfLevel(level);
  std::array<std::int64_t, 2> cells{};  // in a period
  Eigen::Array2d edges(edge, edge);
  for (int k = 0; k < 2; ++k) {
    if (!(lattice.period[k] > 0)) continue;
    cells[static_cast<std::size_t>(k)] = std::max(1L, std::lround(lattice.period[k] / edge));
    edges[k] = lattice.period[k] / static_cast<double>(cells[static_cast<std::size_t>(k)]);
  }
  // Cells that had to be made smaller or larger to fit the period hold landmarks less or more often.
  const double share = lattice.share * edges.prod() / (edge * edge);
  const auto cellOf = [&](double at, int k) { return static_cast<std::int64_t>(std::floor(at / edges[k])); };
  for (std::int64_t u = cellOf(low.x(), 0); u <= cellOf(high.x(), 0); ++u) {
    for (std::int64_t v = cellOf(low.y(), 1); v <= cellOf(high.y(), 1); ++v) {
      const std::uint64_t look = mixed(lattice.seed, level, wrapped(u, cells[0]), wrapped(v, cells[1]));
      ThingRandom random(look, 1);
      if (random.uniform() >= share) continue;
      Landmark landmark;
      // 1 / d^2 even over the octave.
      landmark.size = sizeOfLevel(level) / std::sqrt(1 - 0.75 * random.uniform());
      if (landmark.size < smallest || landmark.size > largest) continue;
      const Eigen::Vector2d at(edges.x() * (static_cast<double>(u) + random.uniform()),
                               edges.y() * (static_cast<double>(v) + random.uniform()));
      if (lattice.radius > 0 && at.squaredNorm() >= lattice.radius * lattice.radius) continue;
      landmark.north_east =
          lattice.origin + Eigen::Vector2d(c * at.x() - s * at.y(), s * at.x() + c * at.y());
      landmark.detection =
          config_.least_detection + (config_.most_detection - config_.least_detection) * random.uniform();
      landmark.appearance = hash64(look, 2);
      landmark.key = mixed(hash64(lattice.seed, lattice.copy), level, u, v);
      visitor(landmark);
    }
  }
}

}  // namespace fathom::sim

#include "sim/features/landmarks.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>

#include "realtime/base/numbers/hash64.hpp"
#include "sim/sea/ground/noise.hpp"

namespace fathom::sim {
namespace {

constexpr double kOctaveSize = 0.01;  // smallest of octave 0 [m]
constexpr int kViewOctaves = 2;       // size octaves that a view shows

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

Landmarks::Landmarks(const TerrainConfig& terrain, const SimulatedFeatureConfig& config, double view_px,
                     double smallest_px)
    : config_(config) {
  // Cells of kViewOctaves octaves in a view: view / cell^2 (1 + 1/4 + ...).
  double octaves = 0;
  for (int k = 0; k < kViewOctaves; ++k) octaves += std::ldexp(1.0, -2 * k);
  cell_per_size_ = std::sqrt(octaves * view_px / config.landmarks_per_view) / smallest_px;

  Lattice ground;
  ground.seed = hash64(terrain.seed, 700);
  ground.share = 1 - config.alike_share;
  if (ground.share > 0) ground_lattices_.push_back(ground);
  if (config.alike_share > 0) {
    Lattice ripples;
    ripples.seed = hash64(terrain.seed, 701);
    ripples.heading = terrain.ripples.direction_rad;
    ripples.period = {terrain.ripples.wavelength_m, config.alike_along_m};
    ripples.share = config.alike_share;
    ground_lattices_.push_back(ripples);
  }
  for (const PlacedConfig& object : terrain.placed) {
    Lattice own;
    own.seed = hash64(object.seed, 702);
    own.origin = {object.north_m, object.east_m};
    own.heading = object.heading_rad;
    own.radius = 0.5 * object.size_m;
    own.copy = object_lattices_.size() + 1;
    object_lattices_.push_back(own);
  }
}

bool Landmarks::onPlacedObject(const Eigen::Vector2d& north_east) const {
  return std::any_of(object_lattices_.begin(), object_lattices_.end(), [&](const Lattice& object) {
    return (north_east - object.origin).squaredNorm() < object.radius * object.radius;
  });
}

void Landmarks::visit(const std::vector<Eigen::Vector2d>& corners, double smallest, double largest,
                      const Visitor& visitor) const {
  if (corners.empty() || !(smallest > 0) || !(largest >= smallest)) return;
  const int first = static_cast<int>(std::floor(std::log2(smallest / kOctaveSize)));
  const int last = static_cast<int>(std::floor(std::log2(largest / kOctaveSize)));
  for (int level = first; level <= last; ++level) {
    for (const Lattice& lattice : ground_lattices_)
      visitLevel(lattice, level, corners, smallest, largest, [&](const Landmark& landmark) {
        if (!onPlacedObject(landmark.north_east)) visitor(landmark);
      });
    for (const Lattice& lattice : object_lattices_)
      visitLevel(lattice, level, corners, smallest, largest, visitor);
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
  // The period changes the cells' area; the probability of a landmark in a cell changes with it.
  const double share = lattice.share * edges.prod() / (edge * edge);
  const auto cellOf = [&](double at, int k) { return static_cast<std::int64_t>(std::floor(at / edges[k])); };
  for (std::int64_t u = cellOf(low.x(), 0); u <= cellOf(high.x(), 0); ++u) {
    for (std::int64_t v = cellOf(low.y(), 1); v <= cellOf(high.y(), 1); ++v) {
      const std::uint64_t cell = mixed(lattice.seed, level, wrapped(u, cells[0]), wrapped(v, cells[1]));
      GroundRandom random(cell, 1);
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
      landmark.appearance = hash64(cell, 2);
      landmark.key = mixed(hash64(lattice.seed, lattice.copy), level, u, v);
      visitor(landmark);
    }
  }
}

namespace {

constexpr std::size_t kBins = std::tuple_size_v<RootSift>, kLatent = 12;
constexpr float kOwn = 0.35F;  // standard deviation of a bin's own part, by that of the common one
constexpr float kNorm = 512, kTop = 255;

// A nearly normal number of unit variance from 16 bits: how many bits are set, and where.
float deviate(std::uint32_t bits) {
  constexpr float kScale = 0.494872F;  // 1 / sqrt(16 / 4 + 1 / 12): of the count and of the fraction
  const float fraction = static_cast<float>((bits * 40503U >> 4) & 0xFFF) / 4096.0F - 0.5F;
  return (static_cast<float>(std::popcount(bits & 0xFFFFU)) - 8.0F + fraction) * kScale;
}

// A stream of such numbers, four of each hash.
class Deviates {
 public:
  explicit Deviates(std::uint64_t seed) : state_(seed) {}
  float next() {
    if (left_ == 0) {
      bits_ = state_ = hash64(state_);
      left_ = 4;
    }
    --left_;
    const auto low = static_cast<std::uint32_t>(bits_ & 0xFFFF);
    bits_ >>= 16;
    return deviate(low);
  }

 private:
  std::uint64_t state_, bits_ = 0;
  int left_ = 0;
};

using Mixing = std::array<std::array<float, kLatent>, kBins>;

const Mixing& mixing() {
  static const Mixing kMixing = [] {
    Mixing m;
    Deviates random(0x46656174);
    for (auto& row : m) {
      float squares = 0;
      for (float& v : row) {
        v = random.next();
        squares += v * v;
      }
      for (float& v : row) v /= std::sqrt(squares);
    }
    return m;
  }();
  return kMixing;
}

}  // namespace

RootSift simulatedDescriptor(std::uint64_t appearance, std::uint64_t view_seed, std::uint64_t feature,
                             float noise) {
  Deviates own(hash64(appearance, 1)), view(hash64(hash64(appearance, view_seed), feature));
  std::array<float, kLatent> z;
  for (float& v : z) v = own.next();
  const Mixing& m = mixing();
  std::array<float, kBins> g;
  const float spread = noise * std::sqrt(1 + kOwn * kOwn);
  float squares = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    float sum = kOwn * own.next() + spread * view.next();
    for (std::size_t k = 0; k < kLatent; ++k) sum += m[i][k] * z[k];
    g[i] = std::abs(sum);
    squares += sum * sum;
  }
  const float scale = squares > 0 ? kNorm / std::sqrt(squares) : 0.0F;
  RootSift descriptor;
  for (std::size_t i = 0; i < kBins; ++i)
    descriptor[i] = static_cast<std::uint8_t>(std::lround(std::min(scale * g[i], kTop)));
  return descriptor;
}

}  // namespace fathom::sim

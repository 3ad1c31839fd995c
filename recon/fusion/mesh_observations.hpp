#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "recon/fusion/quadtree_map.hpp"
#include "recon/fusion/tile_index.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

// Units of the onboard map's whole numbers. Heights have units of 2^-13 m; a bin is a slice of nav's depth
// with a thickness of a power of two units, so that a bin of a coarser level is one or two of the finer one.
constexpr int kHeightBits = 13;
constexpr double kHeightUnit = 1.0 / (1 << kHeightBits);  // [m]: 0.12 mm
constexpr int kWeightBits = 10;
constexpr std::uint32_t kMaxWeight = (1U << kWeightBits) - 1;  // of an observation as good as min_sigma

// Thickness of a bin [log2 of units]: 1/8 m, more than noise and pose errors, less than the height of a fish
// above the floor; at coarser cells two spacings, for a slope within the cell; never above 4 m, so that the
// sums of squares fit.
inline int binShift(double spacing) {
  return std::clamp(std::ilogb(2 * spacing), -3, 2) + kHeightBits;
}

inline std::int32_t heightUnits(double depth) {
  return static_cast<std::int32_t>(std::lround(depth / kHeightUnit));
}

// 1 / sigma^2 relative to that of min_sigma, as a whole number of at least one.
inline std::uint32_t weightOf(double sigma, double min_sigma) {
  const double ratio = min_sigma / std::max(sigma, min_sigma);
  return std::max<std::uint32_t>(1, static_cast<std::uint32_t>(std::lround(ratio * ratio * kMaxWeight)));
}

// Sums over the observations of one cell in one bin. Heights are above or at the bin's lower edge, so all
// sums are of numbers >= 0; they are exact up to 2^24 observations, and adding and subtracting in any order
// gives the same numbers.
class LayerSums {
 public:
  static constexpr int kCountBits = 24;
  static constexpr int kColourBits = 42;  // 10 of the weight, 8 of the colour, 24 of the count

  // One observation.
  static LayerSums of(std::uint32_t weight, std::uint32_t height, const Rgb& colour) {
    LayerSums s;
    const std::uint64_t w = weight;
    s.weight_and_count_ = (w << kCountBits) | 1;
    s.height_ = w * height;
    s.squares_ = w * height * height;
    const Wide colours = static_cast<Wide>(w * colour[0]) |
                         (static_cast<Wide>(w * colour[1]) << kColourBits) |
                         (static_cast<Wide>(w * colour[2]) << (2 * kColourBits));
    s.setColours(colours);
    return s;
  }

  // From saved state; fits(): whether the numbers are valid sums.
  using Colours = std::array<std::uint64_t, 3>;
  static bool fits(std::uint64_t count, std::uint64_t weight, const Colours& colours) {
    return count >> kCountBits == 0 && weight >> (64 - kCountBits) == 0 &&
           ((colours[0] | colours[1] | colours[2]) >> kColourBits) == 0;
  }
  static LayerSums from(std::uint64_t count, std::uint64_t weight, std::uint64_t height,
                        std::uint64_t squares, const Colours& colours) {
    LayerSums s;
    s.weight_and_count_ = weight << kCountBits | count;
    s.height_ = height;
    s.squares_ = squares;
    s.setColours(static_cast<Wide>(colours[0]) | static_cast<Wide>(colours[1]) << kColourBits |
                 static_cast<Wide>(colours[2]) << (2 * kColourBits));
    return s;
  }

  LayerSums& operator+=(const LayerSums& o) {
    weight_and_count_ += o.weight_and_count_;
    height_ += o.height_;
    squares_ += o.squares_;
    setColours(colours() + o.colours());
    return *this;
  }
  LayerSums& operator-=(const LayerSums& o) {
    weight_and_count_ -= o.weight_and_count_;
    height_ -= o.height_;
    squares_ -= o.squares_;
    setColours(colours() - o.colours());
    return *this;
  }
  // The same observations, with heights counted from `lower` units further up (a smaller depth).
  void rebase(std::uint64_t lower) {
    squares_ += 2 * lower * height_ + lower * lower * weight();
    height_ += lower * weight();
  }

  [[nodiscard]] std::uint32_t count() const {
    return static_cast<std::uint32_t>(weight_and_count_ & ((1U << kCountBits) - 1));
  }
  [[nodiscard]] std::uint64_t weight() const { return weight_and_count_ >> kCountBits; }
  [[nodiscard]] std::uint64_t height() const { return height_; }
  [[nodiscard]] std::uint64_t squares() const { return squares_; }
  [[nodiscard]] std::uint64_t colour(int channel) const {
    return static_cast<std::uint64_t>(colours() >> (channel * kColourBits)) &
           ((std::uint64_t{1} << kColourBits) - 1);
  }
  friend bool operator==(const LayerSums&, const LayerSums&) = default;

 private:
  __extension__ typedef unsigned __int128 Wide;
  [[nodiscard]] Wide colours() const { return (static_cast<Wide>(colour_high_) << 64) | colour_low_; }
  void setColours(Wide c) {
    colour_low_ = static_cast<std::uint64_t>(c);
    colour_high_ = static_cast<std::uint64_t>(c >> 64);
  }

  std::uint64_t weight_and_count_ = 0;              // sum of weights above, number of observations below
  std::uint64_t height_ = 0;                        // sum of weight * height
  std::uint64_t squares_ = 0;                       // sum of weight * height^2
  std::uint64_t colour_low_ = 0, colour_high_ = 0;  // sums of weight * colour, three of 42 bits
};

// A cell's sums in one bin, in the pool: cells are lists of layers, uppermost (least depth) first.
struct Layer {
  LayerSums sums;
  std::int32_t bin = 0;    // nav z in units, shifted right by the level's bin shift
  std::int32_t next = -1;  // in the pool
};
static_assert(sizeof(Layer) == 48);

// One mesh's observation of one cell.
struct CellObservation {
  std::uint64_t place = 0;   // of the cell: see MeshObservations
  std::int32_t height = 0;   // nav z [2^-13 m]
  std::uint16_t weight = 0;  // 1 to kMaxWeight
  Rgb colour{};

  [[nodiscard]] int level() const { return static_cast<int>(place >> 56); }
  [[nodiscard]] TileKey tile() const {
    constexpr std::int32_t kBias = 1 << 23, kMask = (1 << 24) - 1;
    return {static_cast<std::int32_t>((place >> 32) & kMask) - kBias,
            static_cast<std::int32_t>((place >> 8) & kMask) - kBias, static_cast<std::int16_t>(level())};
  }
  [[nodiscard]] int cell() const { return static_cast<int>(place & 0xFF); }  // 16 * northwards + eastwards
};
static_assert(sizeof(CellObservation) == 24);

// A mesh in nav as whole-numbered observations: a pure function of the mesh, so that the map can subtract
// them again. Cell (i, j) of a level covers [i, i + 1) x [j, j + 1) spacings and is observed where its middle
// is under a triangle. The level follows from the mesh's mean point spacing, and is coarser for larger
// triangles. Of surfaces over one another the upper one counts, which the camera saw. Observations are
// ordered by level, tile and cell.
class MeshObservations {
 public:
  // A mesh with more cells is observed a level coarser: 64 m^2 at 1/32 m.
  static constexpr std::size_t kMost = 65536;

  explicit MeshObservations(const QuadtreeConfig& config);

  // Valid until the next call. Triangles with vertices that are not finite or too far are skipped.
  std::span<const CellObservation> collect(const Mesh& mesh_in_nav);
  [[nodiscard]] std::size_t skippedTriangles() const { return skipped_; }  // by the last collect()
  [[nodiscard]] std::size_t memoryBytes() const { return found_.capacity() * sizeof(CellObservation); }

 private:
  [[nodiscard]] double spacing(int level) const { return config_.root_size / (1 << level) / kTileCells; }
  // Finest level with cells no smaller than the configured ratio of a point spacing [m].
  [[nodiscard]] int levelFor(double point_spacing) const;
  // False when there are more than kMost.
  bool collectAt(const Mesh& mesh, int finest);
  bool observe(const Mesh& mesh, const std::array<std::uint32_t, 3>& triangle, int finest);

  QuadtreeConfig config_;
  std::vector<CellObservation> found_;
  std::size_t skipped_ = 0;
};

}  // namespace fathom::fusion

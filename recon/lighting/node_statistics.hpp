#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::lighting {

[[nodiscard]] inline std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

// The samples of one channel within an image: all of a mono image, one of four of a Bayer mosaic, one of
// three of RGB.
struct Channel {
  int column = 0, row = 0;  // first sample; columns count samples, not pixels
  int column_step = 1, row_step = 1;
  int width = 0, height = 0;  // samples of the channel in a row, and rows
};

[[nodiscard]] inline std::vector<Channel> channelsOf(int width, int height, PixelFormat format) {
  switch (format) {
    case PixelFormat::kMono:
      return {{0, 0, 1, 1, width, height}};
    case PixelFormat::kRgb:
      return {{0, 0, 3, 1, width, height}, {1, 0, 3, 1, width, height}, {2, 0, 3, 1, width, height}};
    case PixelFormat::kBayerRggb:
      break;
  }
  std::vector<Channel> channels;
  for (int row = 0; row < 2; ++row)
    for (int column = 0; column < 2; ++column)
      channels.push_back({column, row, 2, 2, (width + 1 - column) / 2, (height + 1 - row) / 2});
  return channels;
}

// Nodes in the middles of equal cells that tile the image, the same for all its channels.
struct NodeLattice {
  static constexpr int kMaxSide = 128;  // nodes in a row or column: the pattern is far smoother

  int columns = 1, rows = 1;
  int width = 0, height = 0;  // of the image [px]

  NodeLattice() = default;
  // Cells about `grid` pixels wide.
  NodeLattice(int image_width, int image_height, int grid)
      : columns(cells(image_width, grid)),
        rows(cells(image_height, grid)),
        width(image_width),
        height(image_height) {}

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
  // Middle of a column or row of nodes, in parts of the image's side.
  [[nodiscard]] float u(int column) const {
    return (static_cast<float>(column) + 0.5F) / static_cast<float>(columns);
  }
  [[nodiscard]] float v(int row) const { return (static_cast<float>(row) + 0.5F) / static_cast<float>(rows); }

 private:
  static int cells(int side, int cell) { return std::clamp((side + cell / 2) / cell, 1, kMaxSide); }
};

// Classes of range, equal in log r: a third of an octave wide from 0.5 to 16 m, and one more for samples of
// unknown range.
struct RangeBins {
  static constexpr int kKnown = 15, kUnknown = 15, kAll = 16;
  static constexpr float kNearest = 0.5F;  // [m]
  static constexpr float kPerOctave = 3.0F;

  // log2 of a range in units of bins (bin k has its middle at k), clamped to the known bins.
  [[nodiscard]] static float position(float range);
  [[nodiscard]] static double middle(int bin);  // [m]
  // Interpolates values at the middles of the bins at a range [m].
  [[nodiscard]] static float between(const std::array<float, kKnown>& values, float range) {
    const float at = position(range);
    const int bin = std::min(static_cast<int>(at), kKnown - 2);
    const float t = at - static_cast<float>(bin);
    return (1 - t) * values[index(bin)] + t * values[index(bin + 1)];
  }
};

// Moments of samples in parts of full scale, without the outliers.
struct Moments {
  double count = 0, mean = 0, variance = 0;
  double x_mean = 0, x_variance = 0;  // of the natural logarithm of the range
};

// Statistics of one channel's samples: for every node and class of range a histogram of brightness (in
// logarithms) with the sum in each class, and Welford's mean and variance. The histogram gives an interval of
// inliers, outside which are fish, shadows and glints; moments() are those of the inliers. Memory is fixed.
//
// A sample of an image with e times the usual exposure is b + e L: light L, and the sensor's black level b,
// which exposure leaves alone. Divided by e it falls with 1/e to L; b is the slope of that within a node and
// class of range, all of them together. Everything is brought to the usual exposure, at which it is b + L.
class NodeStatistics {
 public:
  NodeStatistics(const Channel& channel, const NodeLattice& lattice);

  // Takes up to 16 samples spread over each node's cell, those below `saturated` (of full scale) that the
  // image's mask does not hide, of an image with `exposure` times the usual exposure and, at each node,
  // `slope` times the light of perpendicular ground. `T`: uint8_t or uint16_t, as the image's bits are;
  // `ranges`: a node's path length [m], not positive: unknown. `means` receives each node's mean in this
  // image, or -1 if none of its samples was taken.
  template <typename T>
  void add(const ImageView& image, float saturated, float exposure, std::span<const float> slope,
           std::span<const float> ranges, std::span<float> means);

  // The black level, parts of full scale, from the samples so far; 0 where all exposures are alike.
  void findBlack();
  [[nodiscard]] float black() const { return black_; }

  // Halves the weight of all samples so far; cells left with less than one sample are cleared.
  void halve();

  // Computes the intervals again: `outlier` robust standard deviations about the median.
  void findOutliers(double outlier);
  // Of the samples within the interval, since the last findOutliers().
  [[nodiscard]] Moments moments(std::size_t node, int bin) const;
  // Bit `bin`: whether the node has samples of that class of range.
  [[nodiscard]] unsigned binsOf(std::size_t node) const { return bins_[node]; }
  // Saturated and outlying samples, of all.
  [[nodiscard]] std::uint64_t saturatedSamples() const { return saturated_; }
  [[nodiscard]] double outlierShare() const { return outlier_share_; }

  [[nodiscard]] const NodeLattice& lattice() const { return lattice_; }
  [[nodiscard]] const Channel& channel() const { return channel_; }
  [[nodiscard]] std::size_t memoryBytes() const;

  // For saved state (state_archive.hpp), bit by bit: only cells with samples.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.fixed(self.bins_);
    archive.fixed(self.intervals_);
    archive(self.saturated_, self.outlier_share_, self.black_);
    for (const Interval& i : self.intervals_)
      archive.require(i.first <= i.last && i.last < kClasses, "an interval of brightness that is none");
    for (std::size_t k = 0; k < self.cells_.size(); ++k) {
      if constexpr (Archive::kLoading) self.cells_[k] = Cell{};
      if ((self.bins_[k / RangeBins::kAll] >> k % RangeBins::kAll & 1U) != 0) archive(self.cells_[k]);
    }
  }

  static constexpr int kSide = 4;  // samples of a cell, across and down
  static constexpr int kSamplesPerImage = kSide * kSide;

 private:
  static constexpr int kClasses = 49;  // of brightness: four an octave, over 12 bits
  struct Cell {
    double count = 0, mean = 0, squares = 0;  // squares: sum of squared differences from the mean
    double x_mean = 0, x_squares = 0;
    std::array<std::uint16_t, kClasses> number{};
    std::array<float, kClasses> sum{};
    // Of the node's means in images that are hardly clipped: weight, means and sums of products of their
    // differences from these. value: over exposure; darker: 1 / exposure; x: logarithm of the range.
    struct Exposed {
      float count = 0, value = 0, darker = 1, x = 0;
      float darker_darker = 0, darker_value = 0, darker_x = 0, x_value = 0, x_x = 0;
      void add(float new_value, float new_darker, float new_x);
      void halve();
      static void exchange(auto& archive, auto& self) {
        archive(self.count, self.value, self.darker, self.x, self.darker_darker, self.darker_value,
                self.darker_x, self.x_value, self.x_x);
      }
    } exposed;

    static void exchange(auto& archive, auto& self) {
      archive(self.count, self.mean, self.squares, self.x_mean, self.x_squares, self.number, self.sum,
              self.exposed);
    }
  };
  struct Interval {
    std::uint8_t first = 0, last = kClasses - 1;  // classes
  };
  [[nodiscard]] std::size_t block(std::size_t node) const;
  // A mean over exposure, brought to the usual one.
  [[nodiscard]] double atUsual(double mean, double darker) const;

  Channel channel_;
  NodeLattice lattice_;
  int block_columns_, block_rows_;
  std::array<std::uint8_t, 4096> class_of_;
  std::vector<Cell> cells_;          // by node, then bin
  std::vector<std::uint16_t> bins_;  // by node
  std::vector<Interval> intervals_;  // by block of nodes, then bin
  std::uint64_t saturated_ = 0;
  double outlier_share_ = 0;
  float black_ = 0;
};

}  // namespace fathom::lighting

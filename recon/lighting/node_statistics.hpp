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
};

// Moments of samples in parts of full scale, without the outliers.
struct Moments {
  double count = 0, mean = 0, variance = 0;
  double x_mean = 0, x_variance = 0;  // of the natural logarithm of the range
};

// Statistics of one channel's samples: for every node and class of range a histogram of brightness (in
// logarithms) with the sum in each class, and Welford's mean and variance. The histogram gives an interval of
// inliers, outside which are fish, shadows and glints; moments() are those of the inliers. Memory is fixed.
class NodeStatistics {
 public:
  NodeStatistics(const Channel& channel, const NodeLattice& lattice);

  // Takes up to 16 samples spread over each node's cell, those below `saturated` (of full scale) that the
  // image's mask does not hide, and divides them by `brightness` of their node. `T`: uint8_t or uint16_t, as
  // the image's bits are; `ranges`: a node's path length [m], not positive: unknown. `means` receives each
  // node's mean in this image, or -1 if none of its samples was taken.
  template <typename T>
  void add(const ImageView& image, float saturated, std::span<const float> brightness,
           std::span<const float> ranges, std::span<float> means);

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
  [[nodiscard]] std::size_t memoryBytes() const;

  // For saved state (state_archive.hpp), bit by bit: only cells with samples.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.fixed(self.bins_);
    archive.fixed(self.intervals_);
    archive(self.saturated_, self.outlier_share_);
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

    static void exchange(auto& archive, auto& self) {
      archive(self.count, self.mean, self.squares, self.x_mean, self.x_squares, self.number, self.sum);
    }
  };
  struct Interval {
    std::uint8_t first = 0, last = kClasses - 1;  // classes
  };
  [[nodiscard]] std::size_t block(std::size_t node) const;

  Channel channel_;
  NodeLattice lattice_;
  int block_columns_, block_rows_;
  std::array<std::uint8_t, 4096> class_of_;
  std::vector<Cell> cells_;          // by node, then bin
  std::vector<std::uint16_t> bins_;  // by node
  std::vector<Interval> intervals_;  // by block of nodes, then bin
  std::uint64_t saturated_ = 0;
  double outlier_share_ = 0;
};

}  // namespace fathom::lighting

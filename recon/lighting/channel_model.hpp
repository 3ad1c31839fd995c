#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "recon/lighting/node_statistics.hpp"

namespace fathom::lighting {

// Expectation of samples by a model: logarithms of their mean (parts of full scale) and of their standard
// deviation over that mean.
struct Level {
  float log_mean = 0, log_spread = 0;

  static void exchange(auto& archive, auto& self) { archive(self.log_mean, self.log_spread); }
};

// How one channel's light falls off with range r [m]: log mean = log_at_1m + power log r - per_metre r.
struct RangeLaw {
  double log_at_1m = 0, power = 0, per_metre = 0;
  [[nodiscard]] double at(double range) const;
  [[nodiscard]] double slope(double range) const { return power - per_metre * range; }  // d / d log r

  static void exchange(auto& archive, auto& self) { archive(self.log_at_1m, self.power, self.per_metre); }
};

// One channel's three models, fitted to its statistics (n: node, r: range):
//   whole   log m = m0
//   plain   log m = a(n)
//   range   log m = a(n) + T(r) + q(n, r)
// a: the pattern, averaged over more neighbours the fewer images there are; T: the law of range, plus the
// departure from it of classes of range that have images; q: change of the pattern with range (strobes beside
// the camera), shrunk towards 0 where few images support it. Gaps between classes are interpolated; beyond
// the outermost ones the law and their q are continued.
class ChannelModel {
 public:
  ChannelModel(const Channel& channel, const NodeLattice& lattice);

  [[nodiscard]] NodeStatistics& statistics() { return statistics_; }
  [[nodiscard]] const NodeStatistics& statistics() const { return statistics_; }

  // Fits all three to the statistics of `images` images; `outlier`: as in NodeStatistics::findOutliers();
  // `linear`: samples are, so that a black level can be found.
  void solve(int images, double outlier, bool linear);

  [[nodiscard]] bool known() const { return known_; }             // there is a sample
  [[nodiscard]] bool knowsRange() const { return knows_range_; }  // there is one of known range
  [[nodiscard]] const Level& whole() const { return whole_; }
  [[nodiscard]] const Level& plain(std::size_t node) const { return plain_[node]; }
  // `position`: of the range, by RangeBins.
  [[nodiscard]] Level atRange(std::size_t node, float position) const;
  // Mean over nodes and ranges of the ground's standard deviation over mean.
  [[nodiscard]] float contrast() const { return contrast_; }
  // By class of range: logarithm of the mean over all nodes.
  [[nodiscard]] const std::array<float, RangeBins::kKnown>& trend() const { return trend_; }
  // Images that show a class of range.
  [[nodiscard]] double seen(int bin) const { return seen_[index(bin)]; }
  [[nodiscard]] const RangeLaw& law() const { return law_; }
  // What a sample is where all the light of a sample `usual` is multiplied by `brightness`.
  [[nodiscard]] float lit(float usual, float brightness) const {
    return black() + brightness * (usual - black());
  }
  [[nodiscard]] float black() const { return statistics_.black(); }  // parts of full scale
  [[nodiscard]] std::size_t memoryBytes() const;

  // For saved state (state_archive.hpp), bit by bit; every solve() computes the rest.
  static void exchange(auto& archive, auto& self) {
    archive(self.statistics_, self.known_, self.knows_range_, self.whole_, self.law_, self.contrast_,
            self.trend_, self.seen_);
    archive.fixed(self.plain_);
    archive.fixed(self.range_);
  }

 private:
  using Bins = std::array<double, RangeBins::kKnown>;
  struct Cell {
    float weight = 0;                  // in images
    float log_mean = 0, variance = 0;  // relative to the mean, squared
    float x = 0, x_variance = 0;       // logarithm of the range, less the bin's middle
  };
  [[nodiscard]] Cell& cell(std::size_t node, int bin) { return cells_[index(bin) * plain_.size() + node]; }
  // Takes a node's moments into its cells; returns those of all ranges together.
  Moments gather(std::size_t node);
  void fitPlain(int images, int radius);
  void fitLaw(const Bins& images, const Bins& trend);
  void fitRange(int radius);
  void fitPatternChange(int bin, int radius);
  void carryPatternChange();
  void fitSpread(const Bins& images, int radius);
  // Averages `value_` by `weight_` over 2 radius + 1 nodes along rows and columns, fewer but symmetric at the
  // border, so that a slope of the pattern biases no mean. Sums go to `value_`, `weight_`.
  void pool(int radius);

  NodeStatistics statistics_;
  int columns_, rows_;
  bool known_ = false, knows_range_ = false;
  Level whole_;
  RangeLaw law_;
  float contrast_ = 0;
  std::array<float, RangeBins::kKnown> trend_{};
  Bins seen_{};
  std::vector<Level> plain_;                                                    // by node
  std::vector<Level> range_;                                                    // by node, then bin
  std::vector<Cell> cells_;                                                     // by bin, then node
  std::array<bool, RangeBins::kKnown> used_{};                                  // bins that have cells
  std::vector<float> pattern_;                                                  // a, by node
  std::vector<float> evidence_;                                                 // of q, by node, then bin
  std::vector<double> value_, weight_, counts_, across_value_, across_weight_;  // of pool(), by node
};

}  // namespace fathom::lighting

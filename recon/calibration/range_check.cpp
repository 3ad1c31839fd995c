#include "recon/calibration/range_check.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "recon/calibration/robust.hpp"
#include "recon/geometry/order_statistics.hpp"

namespace fathom::calibration {
namespace {

constexpr std::size_t kFewest = 8;      // samples
constexpr std::size_t kBlocks = 10;     // at most
constexpr double kLeastScatter = 1e-4;  // [m]

using Samples = std::vector<RangeSample>;

double ratioOf(const Samples& samples) {
  std::vector<double> ratios;
  for (const RangeSample& s : samples) ratios.push_back(s.stereo / s.dvl);
  return median(std::move(ratios));
}

// (offset, scale) of the robust line. The DVL's side scatters: its four beams are a sample of a rough
// seafloor, stereo's mean is not. So it is the DVL's range that is regressed on stereo's, and the line turned
// round; the other way the scatter would flatten it.
Eigen::Vector2d lineOf(const Samples& samples) {
  constexpr int kIterations = 30;
  Eigen::Vector2d line(0, 1 / ratioOf(samples));  // dvl = line(0) + line(1) * stereo
  for (int i = 0; i < kIterations; ++i) {
    std::vector<double> residuals;
    for (const RangeSample& s : samples) residuals.push_back(s.dvl - line(0) - line(1) * s.stereo);
    const double sigma = std::max(madSigma(residuals, 0.0), kLeastScatter);
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const Eigen::Vector2d row(1, samples[k].stereo);
      const double weight = cauchyWeight(residuals[k] / sigma);
      normal += weight * row * row.transpose();
      right += weight * samples[k].dvl * row;
    }
    line = normal.ldlt().solve(right);
  }
  return {-line(0) / line(1), 1 / line(1)};
}

// The samples in so many consecutive blocks.
std::vector<Samples> blocksOf(const Samples& samples) {
  const std::size_t count = std::clamp<std::size_t>(samples.size() / 3, 2, kBlocks);
  std::vector<Samples> out(count);
  for (std::size_t k = 0; k < samples.size(); ++k) out[k * count / samples.size()].push_back(samples[k]);
  return out;
}

// Standard deviation of an estimate by leaving out one block after another (jackknife).
template <typename Estimate>
Eigen::VectorXd jackknife(const std::vector<Samples>& blocks, const Estimate& estimate) {
  std::vector<Eigen::VectorXd> without;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    Samples rest;
    for (std::size_t other = 0; other < blocks.size(); ++other)
      if (other != b) rest.insert(rest.end(), blocks[other].begin(), blocks[other].end());
    without.push_back(estimate(rest));
  }
  const auto n = static_cast<double>(without.size());
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(without[0].size()), squares = mean;
  for (const auto& w : without) mean += w / n;
  for (const auto& w : without) squares += (w - mean).cwiseAbs2();
  return ((n - 1) / n * squares).cwiseSqrt();
}

}  // namespace

RangeCheck checkRanges(const std::vector<RangeSample>& samples) {
  RangeCheck out;
  out.samples = samples.size();
  if (samples.size() < kFewest) return out;
  std::vector<double> ranges, off;
  for (const RangeSample& s : samples) ranges.push_back(s.dvl);
  std::sort(ranges.begin(), ranges.end());
  out.shortest = ranges[ranges.size() / 20];
  out.longest = ranges[ranges.size() - 1 - ranges.size() / 20];
  out.ratio = ratioOf(samples);
  for (const RangeSample& s : samples) off.push_back(s.stereo / s.dvl - out.ratio);
  out.scatter = madSigma(off, 0.0);
  const std::vector<Samples> blocks = blocksOf(samples);
  std::vector<double> of_blocks;
  for (const Samples& block : blocks) of_blocks.push_back(ratioOf(block));
  double squares = 0;
  for (const double r : of_blocks) squares += (r - out.ratio) * (r - out.ratio);
  const auto n = static_cast<double>(blocks.size());
  out.ratio_sigma = std::sqrt(squares / (n * (n - 1)));

  constexpr double kSpan =
      1.25;  // of longest over shortest, below which scale and offset cannot be told apart
  out.line_known = out.longest > kSpan * out.shortest;
  if (!out.line_known) return out;
  const Eigen::Vector2d line = lineOf(samples);
  const Eigen::VectorXd sigma =
      jackknife(blocks, [](const Samples& s) { return Eigen::VectorXd(lineOf(s)); });
  out.offset = line(0), out.scale = line(1);
  out.offset_sigma = sigma(0), out.scale_sigma = sigma(1);
  return out;
}

}  // namespace fathom::calibration

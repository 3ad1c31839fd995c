#include "recon/lighting/pixel_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace fathom::lighting {
namespace {

// Samples that a node's statistics shall rest on. Neighbouring samples, and those of overlapping images, show
// the same stone: perhaps one in fifty is independent, and a seafloor whose brightness varies by 30 % is then
// averaged to 1 %.
constexpr double kWantedSamples = 40000;
constexpr int kSmooth =
    14;  // the strobes' pattern is straight within this part of an image's side, to each side
constexpr double kMinSigma =
    0.002;  // of full scale: half a level of 8 bits; less is quantisation, not texture
constexpr double kMinContrast = 0.04;  // sigma of mean: in thicker haze, gain would show noise alone
constexpr double kMinMean = 0.002;     // of full scale

std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

}  // namespace

PixelStatistics::PixelStatistics(const Channel& channel, int grid)
    : channel_(channel),
      grid_(grid),
      columns_((channel.width - 1) / grid + 2),
      rows_((channel.height - 1) / grid + 2),
      nodes_(index(columns_) * index(rows_)),
      across_(nodes_.size()),
      pooled_(nodes_.size()),
      corrections_(nodes_.size()) {}

template <typename T>
void PixelStatistics::add(const T* samples, std::size_t stride, float full_scale, float saturated) {
  const int reach = grid_ / 4;  // of the samples about a node
  const float scale = 1.0F / full_scale;
  for (int j = 0; j < rows_; ++j) {
    for (int i = 0; i < columns_; ++i) {
      Moments& node = nodes_[index(j * columns_ + i)];
      for (int dy = -reach; dy <= reach; dy += std::max(2 * reach, 1)) {
        const int y = std::clamp(j * grid_ + dy, 0, channel_.height - 1);
        const T* line = samples + index(channel_.row + y * channel_.row_step) * stride + channel_.column;
        for (int dx = -reach; dx <= reach; dx += std::max(2 * reach, 1)) {
          const int x = std::clamp(i * grid_ + dx, 0, channel_.width - 1);
          const float value = scale * static_cast<float>(line[x * channel_.column_step]);
          if (value >= saturated) continue;
          node.count += 1;
          const double delta = value - node.mean;
          node.mean += delta / node.count;
          node.squares += delta * (value - node.mean);
        }
      }
    }
  }
}

template void PixelStatistics::add(const std::uint8_t*, std::size_t, float, float);
template void PixelStatistics::add(const std::uint16_t*, std::size_t, float, float);

// Chan, Golub & LeVeque 1979.
void PixelStatistics::merge(Moments& into, const Moments& other) {
  const double count = into.count + other.count;
  if (count == 0) return;
  const double delta = other.mean - into.mean;
  into.mean += delta * other.count / count;
  into.squares += other.squares + delta * delta * into.count * other.count / count;
  into.count = count;
}

Correction PixelStatistics::correction(const Moments& moments, const Target& target) {
  const double sigma = std::sqrt(moments.squares / std::max(moments.count, 1.0));
  const double mean = std::max(moments.mean, kMinMean);
  const double gain = target.sigma / std::max({sigma, kMinSigma, kMinContrast * mean});
  return {static_cast<float>(gain), static_cast<float>(target.mean - gain * moments.mean)};
}

PixelStatistics::Moments PixelStatistics::whole() const {
  Moments sum;
  for (const Moments& node : nodes_) merge(sum, node);
  return sum;
}

// Means and the spreads about each node's own mean are added up apart, so that a slope of the pattern is not
// taken for texture; alike on both sides (fewer nodes near the edge), so that it moves no mean either.
void PixelStatistics::pool(int radius) {
  const auto add = [](Sums& into, const Sums& other) {
    into.count += other.count;
    into.value += other.value;
    into.squares += other.squares;
  };
  for (int j = 0; j < rows_; ++j) {
    for (int i = 0; i < columns_; ++i) {
      const int reach = std::min({radius, i, columns_ - 1 - i});
      Sums sums;
      for (int k = i - reach; k <= i + reach; ++k) {
        const Moments& node = nodes_[index(j * columns_ + k)];
        add(sums, {node.count, node.count * node.mean, node.squares});
      }
      across_[index(j * columns_ + i)] = sums;
    }
  }
  for (int j = 0; j < rows_; ++j) {
    const int reach = std::min({radius, j, rows_ - 1 - j});
    for (int i = 0; i < columns_; ++i) {
      Sums sums;
      for (int k = j - reach; k <= j + reach; ++k) add(sums, across_[index(k * columns_ + i)]);
      pooled_[index(j * columns_ + i)] = sums;
    }
  }
}

void PixelStatistics::solve(const Target& target, int images) {
  const int a_side = grid_ >= 4 ? 2 : 1;  // samples about a node
  const double nodes_wanted = kWantedSamples / (static_cast<double>(images) * a_side * a_side);
  pool(std::clamp(static_cast<int>(0.5 * std::sqrt(nodes_wanted)), 0, std::max(columns_, rows_) / kSmooth));
  const Moments all = whole();
  // A node's samples of one image are much alike: each image gives one degree of freedom, and the mean took
  // one.
  const double freedom = images > 1 ? static_cast<double>(images) / (images - 1) : 1.0;
  for (std::size_t n = 0; n < nodes_.size(); ++n) {
    const Sums& sums = pooled_[n];
    const bool known = images > 1 && sums.count > 1;
    corrections_[n] = correction(
        known ? Moments{sums.count, sums.value / sums.count, sums.squares * freedom} : all, target);
  }
}

void PixelStatistics::solveWhole(const Target& target) {
  std::fill(corrections_.begin(), corrections_.end(), correction(whole(), target));
}

void PixelStatistics::corrections(int row, int first, int count, float* gain, float* offset, int step) const {
  const int j = row / grid_;
  const float down = static_cast<float>(row - j * grid_) / static_cast<float>(grid_);
  const Correction* upper = &corrections_[index(j * columns_)];
  const Correction* lower = upper + columns_;
  const auto mix = [](float a, float b, float t) { return a + t * (b - a); };
  const float part = 1.0F / static_cast<float>(grid_);
  int k = first;
  while (k < first + count) {
    const int i = k / grid_;
    const float gain0 = mix(upper[i].gain, lower[i].gain, down);
    const float gain1 = mix(upper[i + 1].gain, lower[i + 1].gain, down);
    const float offset0 = mix(upper[i].offset, lower[i].offset, down);
    const float offset1 = mix(upper[i + 1].offset, lower[i + 1].offset, down);
    const int end = std::min(first + count, (i + 1) * grid_);
    for (; k < end; ++k) {
      const float t = part * static_cast<float>(k - i * grid_);
      gain[(k - first) * step] = mix(gain0, gain1, t);
      offset[(k - first) * step] = mix(offset0, offset1, t);
    }
  }
}

}  // namespace fathom::lighting

#include "recon/lighting/channel_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace fathom::lighting {
namespace {

// Samples that a node's statistics shall rest on. Neighbouring samples, and those of overlapping images, show
// the same stone: perhaps one in fifty is independent, and a seafloor with 30 % of texture is then averaged
// to 1 %.
constexpr double kWantedSamples = 40000;
// The strobes' pattern is straight, in logarithms, within this part of an image's side, to each side.
constexpr int kSmooth = 14;
constexpr double kMinMean = 1e-5;      // of full scale: a fraction of a level of 16 bits
constexpr double kMinVariance = 1e-4;  // relative: 1 %; no sensor shows less texture
constexpr double kMaxVariance = 4;
constexpr int kRounds = 5;  // of fitting pattern and trend in turn: the change is then below 0.1 %

// Mean brightness of images of one range differs by as much as the seafloor does from image to image.
constexpr double kSceneSigma = 0.15;
constexpr double kLawImages = 20;   // most of one class of range that count for the law: it shall fit all
constexpr double kTrendImages = 4;  // of a class of range, that weigh as much as the law
// A priori: light of a strobe beside the camera falls by the square of the distance, and clear to coastal
// water takes 0.1 to 0.4 of it a metre, twice over (Jerlov I to 3; Akkaynak & Treibitz 2018 for the spread).
constexpr double kPower = -2, kPowerSigma = 1, kPerMetre = 0.4, kPerMetreSigma = 0.4;
// Node-images that weigh as much as the prior that the pattern is the same at all ranges: texture of 30 %
// within a node against changes of the pattern of 10 %.
constexpr float kSamePattern = 9;
constexpr float kPatternImages = 8;  // most of one class of range that count in its neighbours
constexpr float kNeighbourBin = 0.25F;

void merge(Moments& into, const Moments& other) {
  if (other.count == 0) return;
  const double count = into.count + other.count;
  const double share = other.count / count, delta = other.mean - into.mean;
  into.variance += share * (other.variance - into.variance) + share * (1 - share) * delta * delta;
  into.mean += share * delta;
  into.count = count;
}

double relativeVariance(const Moments& m) {
  const double mean = std::max(m.mean, kMinMean);
  return std::clamp(m.variance / (mean * mean), kMinVariance, kMaxVariance);
}

// Values at bins of no evidence from the nearest ones that have some: interpolated between, constant outside.
void bridge(auto has, auto value) {
  int last = -1;
  for (int b = 0; b < RangeBins::kKnown; ++b) {
    if (!has(b)) continue;
    for (int k = last + 1; k < b; ++k) {
      const float t = last < 0 ? 1.0F : static_cast<float>(k - last) / static_cast<float>(b - last);
      value(k) = (1 - t) * value(std::max(last, 0)) + t * value(b);
    }
    last = b;
  }
  for (int k = last + 1; last >= 0 && k < RangeBins::kKnown; ++k) value(k) = value(last);
}

}  // namespace

double RangeLaw::at(double range) const {
  return log_at_1m + power * std::log(range) - per_metre * range;
}

ChannelModel::ChannelModel(const Channel& channel, const NodeLattice& lattice)
    : statistics_(channel, lattice),
      columns_(lattice.columns),
      rows_(lattice.rows),
      plain_(lattice.size()),
      range_(lattice.size() * RangeBins::kKnown),
      cells_(lattice.size() * RangeBins::kKnown),
      pattern_(lattice.size()),
      evidence_(lattice.size() * RangeBins::kKnown),
      value_(lattice.size()),
      weight_(lattice.size()),
      counts_(lattice.size()),
      across_value_(lattice.size()),
      across_weight_(lattice.size()) {}

std::size_t ChannelModel::memoryBytes() const {
  return statistics_.memoryBytes() + plain_.capacity() * sizeof(Level) + range_.capacity() * sizeof(Level) +
         cells_.capacity() * sizeof(Cell) + (pattern_.capacity() + evidence_.capacity()) * sizeof(float) +
         5 * value_.capacity() * sizeof(double);
}

Level ChannelModel::atRange(std::size_t node, float position) const {
  const int bin = std::min(static_cast<int>(position), RangeBins::kKnown - 2);
  const float t = position - static_cast<float>(bin);
  const Level* level = &range_[node * RangeBins::kKnown + index(bin)];
  return {(1 - t) * level[0].log_mean + t * level[1].log_mean,
          (1 - t) * level[0].log_spread + t * level[1].log_spread};
}

void ChannelModel::pool(int radius) {
  for (int j = 0; j < rows_; ++j)
    for (int i = 0; i < columns_; ++i) {
      const int reach = std::min({radius, i, columns_ - 1 - i});
      double value = 0, weight = 0;
      for (int k = i - reach; k <= i + reach; ++k) {
        const std::size_t n = index(j * columns_ + k);
        value += weight_[n] * value_[n];
        weight += weight_[n];
      }
      across_value_[index(j * columns_ + i)] = value;
      across_weight_[index(j * columns_ + i)] = weight;
    }
  for (int j = 0; j < rows_; ++j) {
    const int reach = std::min({radius, j, rows_ - 1 - j});
    for (int i = 0; i < columns_; ++i) {
      double value = 0, weight = 0;
      for (int k = j - reach; k <= j + reach; ++k) {
        value += across_value_[index(k * columns_ + i)];
        weight += across_weight_[index(k * columns_ + i)];
      }
      value_[index(j * columns_ + i)] = value;
      weight_[index(j * columns_ + i)] = weight;
    }
  }
}

void ChannelModel::solve(int images, double outlier, bool linear) {
  if (linear) statistics_.findBlack();
  statistics_.findOutliers(outlier);
  const double nodes_wanted =
      kWantedSamples / (static_cast<double>(images) * NodeStatistics::kSamplesPerImage);
  const int radius =
      std::clamp(static_cast<int>(0.5 * std::sqrt(nodes_wanted)), 0, std::max(columns_, rows_) / kSmooth);
  knows_range_ = false;
  used_.fill(false);
  fitPlain(images, radius);
  if (knows_range_) fitRange(radius);
}

void ChannelModel::fitPlain(int images, int radius) {
  // A node's samples of one image are much alike: each image gives one degree of freedom, and the mean
  // took one.
  const double freedom = images > 1 ? static_cast<double>(images) / (images - 1) : 1.0;
  Moments all;
  for (std::size_t n = 0; n < plain_.size(); ++n) {
    const Moments node = gather(n);
    merge(all, node);
    pattern_[n] = static_cast<float>(relativeVariance(node));
    counts_[n] = node.count;
    value_[n] = std::log(std::max(node.mean, kMinMean));
  }
  known_ = all.count > 0;
  whole_ = {static_cast<float>(std::log(std::max(all.mean, kMinMean))),
            static_cast<float>(0.5 * std::log(relativeVariance(all)))};
  std::fill(plain_.begin(), plain_.end(), whole_);
  contrast_ = std::exp(whole_.log_spread);
  if (images < 2) return;
  weight_ = counts_;
  pool(radius);
  for (std::size_t n = 0; n < plain_.size(); ++n)
    if (weight_[n] > 0) plain_[n].log_mean = static_cast<float>(value_[n] / weight_[n]);
  weight_ = counts_;
  std::copy(pattern_.begin(), pattern_.end(), value_.begin());
  pool(radius);
  for (std::size_t n = 0; n < plain_.size(); ++n)
    if (weight_[n] > 0)
      plain_[n].log_spread = static_cast<float>(0.5 * std::log(freedom * value_[n] / weight_[n]));
  double variance = 0;
  for (const Level& level : plain_) variance += std::exp(2 * static_cast<double>(level.log_spread));
  contrast_ = static_cast<float>(std::sqrt(variance / static_cast<double>(plain_.size())));
}

Moments ChannelModel::gather(std::size_t node) {
  Moments sum;
  const unsigned bins = statistics_.binsOf(node);
  for (int b = 0; b < RangeBins::kAll; ++b) {
    if (b < RangeBins::kKnown) cell(node, b) = {};
    if ((bins >> b & 1U) == 0) continue;
    const Moments m = statistics_.moments(node, b);
    if (m.count == 0) continue;
    merge(sum, m);
    if (b == RangeBins::kUnknown) continue;
    used_[index(b)] = true;
    knows_range_ = true;
    Cell& c = cell(node, b);
    c.weight = static_cast<float>(m.count / NodeStatistics::kSamplesPerImage);
    c.log_mean = static_cast<float>(std::log(std::max(m.mean, kMinMean)));
    c.variance = static_cast<float>(relativeVariance(m));
    c.x = static_cast<float>(m.x_mean - std::log(RangeBins::middle(b)));
    c.x_variance = static_cast<float>(m.x_variance);
  }
  return sum;
}

void ChannelModel::fitLaw(const Bins& images, const Bins& trend) {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const auto observe = [&](const Eigen::Vector3d& row, double value, double weight) {
    information += weight * row * row.transpose();
    right += weight * value * row;
  };
  for (int b = 0; b < RangeBins::kKnown; ++b) {
    if (images[index(b)] <= 0) continue;
    const double range = RangeBins::middle(b);
    observe({1, std::log(range), -range}, trend[index(b)],
            std::min(images[index(b)], kLawImages) / (kSceneSigma * kSceneSigma));
  }
  observe(Eigen::Vector3d::UnitY(), kPower, 1 / (kPowerSigma * kPowerSigma));
  observe(Eigen::Vector3d::UnitZ(), kPerMetre, 1 / (kPerMetreSigma * kPerMetreSigma));
  const Eigen::Vector3d law = information.ldlt().solve(right);
  law_ = {law[0], law[1], law[2]};
}

void ChannelModel::fitRange(int radius) {
  Bins images{}, trend{};
  law_ = {0, kPower, kPerMetre};
  std::fill(pattern_.begin(), pattern_.end(), 0.0F);
  std::array<float, RangeBins::kKnown> slope{};
  for (int round = 0; round < kRounds; ++round) {
    for (int b = 0; b < RangeBins::kKnown; ++b) {
      if (!used_[index(b)]) continue;
      slope[index(b)] = static_cast<float>(law_.slope(RangeBins::middle(b)));
      double sum = 0, weight = 0;
      for (std::size_t n = 0; n < plain_.size(); ++n) {
        const Cell& c = cell(n, b);
        sum += static_cast<double>(c.weight * (c.log_mean - pattern_[n] - slope[index(b)] * c.x));
        weight += static_cast<double>(c.weight);
      }
      trend[index(b)] = weight > 0 ? sum / weight : 0;
      images[index(b)] = weight / static_cast<double>(plain_.size());
    }
    fitLaw(images, trend);
    double sum = 0, total = 0;
    for (std::size_t n = 0; n < plain_.size(); ++n) {
      value_[n] = 0, weight_[n] = 0;
      for (int b = 0; b < RangeBins::kKnown; ++b) {
        if (!used_[index(b)]) continue;
        const Cell& c = cell(n, b);
        const float rest = c.log_mean - static_cast<float>(trend[index(b)]) - slope[index(b)] * c.x;
        value_[n] += static_cast<double>(c.weight * rest);
        weight_[n] += static_cast<double>(c.weight);
      }
      if (weight_[n] > 0) value_[n] /= weight_[n];
      sum += weight_[n] * value_[n];
      total += weight_[n];
    }
    for (std::size_t n = 0; n < plain_.size(); ++n)
      pattern_[n] = weight_[n] > 0 ? static_cast<float>(value_[n] - sum / total) : 0.0F;
  }
  std::copy(pattern_.begin(), pattern_.end(), value_.begin());
  pool(radius);
  for (std::size_t n = 0; n < plain_.size(); ++n)
    pattern_[n] = weight_[n] > 0 ? static_cast<float>(value_[n] / weight_[n]) : 0.0F;

  Bins departure{};
  for (int b = 0; b < RangeBins::kKnown; ++b)
    if (images[index(b)] > 0)
      departure[index(b)] = (trend[index(b)] - law_.at(RangeBins::middle(b))) * images[index(b)] /
                            (images[index(b)] + kTrendImages);
  bridge([&](int b) { return images[index(b)] > 0; }, [&](int b) -> double& { return departure[index(b)]; });
  for (int b = 0; b < RangeBins::kKnown; ++b) {
    const auto level = static_cast<float>(law_.at(RangeBins::middle(b)) + departure[index(b)]);
    for (std::size_t n = 0; n < plain_.size(); ++n) {
      range_[n * RangeBins::kKnown + index(b)].log_mean = level + pattern_[n];
      if (!used_[index(b)]) continue;
      Cell& c = cell(n, b);
      c.log_mean -= pattern_[n] + level + slope[index(b)] * c.x;  // the rest, for q
      c.variance -= slope[index(b)] * slope[index(b)] * c.x_variance;
      c.variance = std::max(c.variance, static_cast<float>(kMinVariance));
    }
  }
  for (int b = 0; b < RangeBins::kKnown; ++b) fitPatternChange(b, std::max(radius, 1));
  carryPatternChange();
  seen_ = images;
  for (int b = 0; b < RangeBins::kKnown; ++b) {
    double sum = 0;
    for (std::size_t n = 0; n < plain_.size(); ++n)
      sum += static_cast<double>(range_[n * RangeBins::kKnown + index(b)].log_mean);
    trend_[index(b)] = static_cast<float>(sum / static_cast<double>(plain_.size()));
  }
  fitSpread(images, radius);
}

void ChannelModel::fitPatternChange(int bin, int radius) {
  const int first = std::max(bin - 1, 0), last = std::min(bin + 1, RangeBins::kKnown - 1);
  if (std::none_of(used_.begin() + first, used_.begin() + last + 1, [](bool used) { return used; })) {
    for (std::size_t n = 0; n < plain_.size(); ++n) {
      evidence_[n * RangeBins::kKnown + index(bin)] = 0;
      range_[n * RangeBins::kKnown + index(bin)].log_spread = 0;
    }
    return;
  }
  for (std::size_t n = 0; n < plain_.size(); ++n) {
    value_[n] = 0, weight_[n] = 0;
    for (int b = first; b <= last; ++b) {
      const Cell& c = cell(n, b);
      const float weight = b == bin ? c.weight : kNeighbourBin * std::min(c.weight, kPatternImages);
      value_[n] += static_cast<double>(weight * c.log_mean);
      weight_[n] += static_cast<double>(weight);
    }
    if (weight_[n] > 0) value_[n] /= weight_[n];
  }
  pool(radius);
  for (std::size_t n = 0; n < plain_.size(); ++n) {
    const std::size_t at = n * RangeBins::kKnown + index(bin);
    evidence_[at] = static_cast<float>(weight_[n]);
    // Held in log_spread until fitSpread(): the table's own place for it.
    range_[at].log_spread = static_cast<float>(value_[n]) / (evidence_[at] + kSamePattern);
  }
}

void ChannelModel::carryPatternChange() {
  for (std::size_t n = 0; n < plain_.size(); ++n) {
    Level* levels = &range_[n * RangeBins::kKnown];
    const float* evidence = &evidence_[n * RangeBins::kKnown];
    bridge([&](int b) { return evidence[b] >= 1; }, [&](int b) -> float& { return levels[b].log_spread; });
    for (int b = 0; b < RangeBins::kKnown; ++b) levels[b].log_mean += levels[b].log_spread;
  }
}

void ChannelModel::fitSpread(const Bins& images, int radius) {
  Bins by_bin{};
  double sum_all = 0, images_all = 0;
  for (int b = 0; b < RangeBins::kKnown; ++b) {
    if (!used_[index(b)]) continue;
    double sum = 0, freedom = 0, once = 0, once_weight = 0;
    for (std::size_t n = 0; n < plain_.size(); ++n) {
      const Cell& c = cell(n, b);
      once += static_cast<double>(c.weight * c.variance);
      once_weight += static_cast<double>(c.weight);
      if (c.weight < 2) continue;  // one image has no scatter between images
      sum += static_cast<double>(c.weight * c.variance);
      freedom += static_cast<double>(c.weight) - 1;
    }
    if (once_weight == 0) continue;
    by_bin[index(b)] = freedom > 0 ? sum / freedom : once / once_weight;
    sum_all += images[index(b)] * by_bin[index(b)];
    images_all += images[index(b)];
  }
  const double all = sum_all / images_all;
  contrast_ = static_cast<float>(std::sqrt(all));
  for (int b = 0; b < RangeBins::kKnown; ++b)
    if (images[index(b)] > 0)
      by_bin[index(b)] = (images[index(b)] * std::log(by_bin[index(b)]) + kTrendImages * std::log(all)) /
                         (images[index(b)] + kTrendImages);
  bridge([&](int b) { return images[index(b)] > 0; }, [&](int b) -> double& { return by_bin[index(b)]; });
  Bins per_bin{};
  for (int b = 0; b < RangeBins::kKnown; ++b) per_bin[index(b)] = std::exp(-by_bin[index(b)]);

  for (std::size_t n = 0; n < plain_.size(); ++n) {
    value_[n] = 0, weight_[n] = 0;
    for (int b = 0; b < RangeBins::kKnown; ++b) {
      if (!used_[index(b)]) continue;
      const Cell& c = cell(n, b);
      value_[n] += static_cast<double>(c.weight * c.variance) * per_bin[index(b)];
      weight_[n] += static_cast<double>(c.weight);
    }
    if (weight_[n] > 0) value_[n] /= weight_[n];
  }
  pool(radius);
  const double value = std::accumulate(value_.begin(), value_.end(), 0.0);
  const double weight = std::accumulate(weight_.begin(), weight_.end(), 0.0);
  for (std::size_t n = 0; n < plain_.size(); ++n) {
    const double relative = weight_[n] > 0 ? value_[n] / weight_[n] / (value / weight) : 1;
    const double log_relative = std::log(std::max(relative, kMinVariance));
    for (int b = 0; b < RangeBins::kKnown; ++b)
      range_[n * RangeBins::kKnown + index(b)].log_spread =
          static_cast<float>(0.5 * (by_bin[index(b)] + log_relative));
  }
}

}  // namespace fathom::lighting

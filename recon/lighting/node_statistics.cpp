#include "recon/lighting/node_statistics.hpp"

#include <cmath>

#include "realtime/base/numbers/portable_math.hpp"

namespace fathom::lighting {
namespace {

constexpr int kBlock = 4;  // nodes across and down that share an interval
// Samples of a block before outliers are rejected: those of its 16 nodes in four images.
constexpr double kEnough = 1000;
constexpr double kClassesPerOctave = 4;
constexpr float kQuantile = 0.16F;  // and 1 - it: one standard deviation off a normal's median

// Where a cumulative share of a histogram is reached, in classes; interpolated within the class.
double quantile(const auto& histogram, double total, double share) {
  double below = 0;
  for (std::size_t k = 0; k < histogram.size(); ++k) {
    const double here = histogram[k];
    if (below + here >= share * total && here > 0)
      return static_cast<double>(k) - 0.5 + (share * total - below) / here;
    below += here;
  }
  return static_cast<double>(histogram.size()) - 1;
}

int binOf(float range) {
  const bool known = std::isfinite(range) && range > 0;
  return known ? static_cast<int>(std::lround(RangeBins::position(range))) : RangeBins::kUnknown;
}

}  // namespace

float RangeBins::position(float range) {
  return std::clamp(std::log2(range / kNearest) * kPerOctave, 0.0F, static_cast<float>(kKnown - 1));
}

double RangeBins::middle(int bin) {
  return kNearest * powerOfTwo(bin / kPerOctave);
}

NodeStatistics::NodeStatistics(const Channel& channel, const NodeLattice& lattice)
    : channel_(channel),
      lattice_(lattice),
      block_columns_((lattice.columns + kBlock - 1) / kBlock),
      block_rows_((lattice.rows + kBlock - 1) / kBlock),
      cells_(lattice.size() * RangeBins::kAll),
      bins_(lattice.size()),
      intervals_(index(block_columns_ * block_rows_) * RangeBins::kAll) {
  for (std::size_t v = 0; v < class_of_.size(); ++v)
    class_of_[v] =
        static_cast<std::uint8_t>(std::lround(kClassesPerOctave * std::log2(static_cast<double>(v) + 1)));
}

std::size_t NodeStatistics::memoryBytes() const {
  return cells_.capacity() * sizeof(Cell) + bins_.capacity() * sizeof(std::uint16_t) +
         intervals_.capacity() * sizeof(Interval) + sizeof(*this);
}

std::size_t NodeStatistics::block(std::size_t node) const {
  const auto columns = static_cast<std::size_t>(lattice_.columns);
  return node / columns / kBlock * static_cast<std::size_t>(block_columns_) + node % columns / kBlock;
}

void NodeStatistics::Cell::Exposed::add(float new_value, float new_darker, float new_x) {
  const float total = count + 1, share = 1 / total, spread = count * share;
  const float v = new_value - value, d = new_darker - darker, dx = new_x - x;
  darker_darker += spread * d * d, darker_value += spread * d * v, darker_x += spread * d * dx;
  x_value += spread * dx * v, x_x += spread * dx * dx;
  count = total, value += share * v, darker += share * d, x += share * dx;
}

void NodeStatistics::Cell::Exposed::halve() {
  for (float* sum : {&count, &darker_darker, &darker_value, &darker_x, &x_value, &x_x}) *sum /= 2;
}

double NodeStatistics::atUsual(double mean, double darker) const {
  constexpr double kLeast = 0.1;  // of what was measured
  return std::max(mean + static_cast<double>(black_) * (1 - darker), kLeast * mean);
}

template <typename T>
void NodeStatistics::add(const ImageView& image, float saturated, float exposure,
                         std::span<const float> slope, std::span<const float> ranges,
                         std::span<float> means) {
  constexpr int kTableBits = 12;
  const T* samples = static_cast<const T*>(image.data);
  const std::size_t stride = image.stride / sizeof(T);
  const int bits = image.bits, samples_per_pixel = image.format == PixelFormat::kRgb ? 3 : 1;
  const float full = static_cast<float>((1 << bits) - 1), scale = 1.0F / full;
  const auto table_index = [bits](T v) {
    const unsigned wide = bits > kTableBits ? static_cast<unsigned>(v) >> (bits - kTableBits)
                                            : static_cast<unsigned>(v) << (kTableBits - bits);
    return std::min(wide, (1U << kTableBits) - 1);
  };
  // The k-th of kSide samples of the node-th of `nodes` cells along a side of `length` samples.
  const auto place = [](int node, int nodes, int k, int length) {
    const int slots = 2 * kSide * nodes;
    return static_cast<int>(static_cast<std::int64_t>(length) * (2 * (node * kSide + k) + 1) / slots);
  };
  std::array<int, NodeLattice::kMaxSide * kSide> columns;
  for (int i = 0; i < lattice_.columns; ++i)
    for (int k = 0; k < kSide; ++k)
      columns[index(i * kSide + k)] =
          channel_.column + place(i, lattice_.columns, k, channel_.width) * channel_.column_step;

  const double image_darker = 1 / static_cast<double>(exposure);
  const std::uint64_t saturated_before = saturated_;
  for (int j = 0; j < lattice_.rows; ++j) {
    std::array<int, kSide> rows;
    for (int k = 0; k < kSide; ++k)
      rows[index(k)] = channel_.row + place(j, lattice_.rows, k, channel_.height) * channel_.row_step;
    for (int i = 0; i < lattice_.columns; ++i) {
      const std::size_t node = index(j * lattice_.columns + i);
      const float range = ranges[node], darker = 1.0F / (exposure * slope[node]);
      const int bin = binOf(range);
      Cell& cell = cells_[node * RangeBins::kAll + index(bin)];
      float n = 0, sum = 0, squares = 0;
      for (const int row : rows) {
        const T* line = samples + index(row) * stride;
        for (int k = 0; k < kSide; ++k) {
          const int column = columns[index(i * kSide + k)];
          if (image.mask != nullptr && image.mask->hides({column / samples_per_pixel, row})) continue;
          const T sample = line[column];
          const float raw = scale * static_cast<float>(sample), value = raw * darker;
          if (raw >= saturated) {
            ++saturated_;
            continue;
          }
          n += 1, sum += value, squares += value * value;
          const float level = std::min(static_cast<float>(sample) * darker + 0.5F, full);
          const std::uint8_t c = class_of_[table_index(static_cast<T>(level))];
          cell.sum[c] += value;
          if (++cell.number[c] == UINT16_MAX)  // older samples count half from here on
            for (std::size_t h = 0; h < kClasses; ++h) cell.number[h] /= 2, cell.sum[h] /= 2;
        }
      }
      means[node] = n > 0 ? sum / n : -1.0F;
      if (n == 0) continue;
      bins_[node] = static_cast<std::uint16_t>(bins_[node] | 1U << bin);
      // Chan, Golub & LeVeque 1979: the image's samples join as one group.
      const double mean = static_cast<double>(sum) / n, total = cell.count + n, share = n / total;
      const double delta = mean - cell.mean;
      cell.squares +=
          std::max(0.0, static_cast<double>(squares) - mean * sum) + delta * delta * cell.count * share;
      cell.mean += delta * share;
      if (bin != RangeBins::kUnknown) {
        const double x = std::log(static_cast<double>(range)), x_delta = x - cell.x_mean;
        cell.x_squares += x_delta * x_delta * cell.count * share;
        cell.x_mean += x_delta * share;
      }
      cell.count = total;
    }
  }
  constexpr double kClipped = 0.02;  // of an image's samples: what is left of more is too dark
  const double clipped = static_cast<double>(saturated_ - saturated_before) / kSamplesPerImage;
  const bool whole = clipped <= kClipped * static_cast<double>(lattice_.size());
  for (std::size_t node = 0; node < lattice_.size(); ++node) {
    if (means[node] < 0) continue;
    const double mean = static_cast<double>(means[node]);
    means[node] = static_cast<float>(atUsual(mean, image_darker));
    if (!whole) continue;
    const float range = ranges[node];
    const int bin = binOf(range);
    cells_[node * RangeBins::kAll + index(bin)].exposed.add(static_cast<float>(mean),
                                                            static_cast<float>(image_darker),
                                                            bin != RangeBins::kUnknown ? std::log(range) : 0);
  }
}

template void NodeStatistics::add<std::uint8_t>(const ImageView&, float, float, std::span<const float>,
                                                std::span<const float>, std::span<float>);
template void NodeStatistics::add<std::uint16_t>(const ImageView&, float, float, std::span<const float>,
                                                 std::span<const float>, std::span<float>);

void NodeStatistics::findBlack() {
  constexpr double kScene = 0.15;                 // images differ by that much, relative
  constexpr double kBlack = 0.02, kMost = 0.1;    // prior, about 0; parts of full scale
  constexpr double kFall = -2.8, kFallSigma = 1;  // prior of d log L / d log r
  const double weight = 1 / (kScene * kScene * static_cast<double>(lattice_.size()));
  double bb = 1 / (kBlack * kBlack), bf = 0, ff = 1 / (kFallSigma * kFallSigma), b = 0, f = kFall * ff;
  for (const Cell& cell : cells_) {
    const Cell::Exposed& e = cell.exposed;
    if (!(e.count > 1) || !(e.value > 0)) continue;
    const double per = 1 / static_cast<double>(e.value);
    bb += weight * per * per * static_cast<double>(e.darker_darker);
    bf += weight * per * static_cast<double>(e.darker_x), ff += weight * static_cast<double>(e.x_x);
    b += weight * per * per * static_cast<double>(e.darker_value);
    f += weight * per * static_cast<double>(e.x_value);
  }
  black_ = static_cast<float>(std::clamp((b * ff - f * bf) / (bb * ff - bf * bf), 0.0, kMost));
}

void NodeStatistics::halve() {
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    std::uint16_t& bins = bins_[k / RangeBins::kAll];
    const unsigned bin = 1U << k % RangeBins::kAll;
    if ((bins & bin) == 0) continue;
    Cell& cell = cells_[k];
    cell.count /= 2, cell.squares /= 2, cell.x_squares /= 2;
    cell.exposed.halve();
    for (std::size_t h = 0; h < kClasses; ++h) {
      const std::uint16_t left = cell.number[h] / 2;
      if (cell.number[h] > 0) cell.sum[h] *= static_cast<float>(left) / static_cast<float>(cell.number[h]);
      cell.number[h] = left;
    }
    if (cell.count >= 1) continue;
    cell = {};
    bins = static_cast<std::uint16_t>(bins & ~bin);
  }
}

void NodeStatistics::findOutliers(double outlier) {
  double all = 0, outside = 0;
  for (int bj = 0; bj < block_rows_; ++bj)
    for (int bi = 0; bi < block_columns_; ++bi)
      for (int bin = 0; bin < RangeBins::kAll; ++bin) {
        std::array<double, kClasses> histogram{};
        double total = 0;
        for (int j = bj * kBlock; j < std::min((bj + 1) * kBlock, lattice_.rows); ++j)
          for (int i = bi * kBlock; i < std::min((bi + 1) * kBlock, lattice_.columns); ++i) {
            const std::size_t node = index(j * lattice_.columns + i);
            if ((bins_[node] >> bin & 1U) == 0) continue;
            const Cell& cell = cells_[node * RangeBins::kAll + index(bin)];
            for (std::size_t k = 0; k < kClasses; ++k) {
              histogram[k] += cell.number[k];
              total += cell.number[k];
            }
          }
        if (total == 0) continue;
        Interval& interval = intervals_[index((bj * block_columns_ + bi) * RangeBins::kAll + bin)];
        interval = {};
        if (total >= kEnough) {
          const double low = quantile(histogram, total, static_cast<double>(kQuantile));
          const double middle = quantile(histogram, total, 0.5);
          const double high = quantile(histogram, total, 1 - static_cast<double>(kQuantile));
          const double first = middle - outlier * std::max(middle - low, 1.0) + 0.5;
          const double last = middle + outlier * std::max(high - middle, 1.0) - 0.5;
          interval.first = static_cast<std::uint8_t>(std::clamp(std::floor(first), 0.0, kClasses - 1.0));
          interval.last = static_cast<std::uint8_t>(std::clamp(std::ceil(last), 0.0, kClasses - 1.0));
        }
        all += total;
        for (std::size_t k = 0; k < kClasses; ++k)
          if (k < interval.first || k > interval.last) outside += histogram[k];
      }
  outlier_share_ = all > 0 ? outside / all : 0;
}

Moments NodeStatistics::moments(std::size_t node, int bin) const {
  const Cell& cell = cells_[node * RangeBins::kAll + index(bin)];
  if (cell.count == 0) return {};
  const Interval interval = intervals_[block(node) * RangeBins::kAll + index(bin)];
  double number = 0, all = 0, sum = 0;
  for (std::size_t k = 0; k < kClasses; ++k) {
    all += cell.number[k];
    if (k < interval.first || k > interval.last) continue;
    number += cell.number[k];
    sum += static_cast<double>(cell.sum[k]);
  }
  Moments m{cell.count, atUsual(cell.mean, static_cast<double>(cell.exposed.darker)),
            cell.squares / cell.count, cell.x_mean, cell.x_squares / cell.count};
  if (number == all || all == 0) return m;
  if (number == 0) return {};
  m.count *= number / all;
  const double inner = sum / number;
  m.mean = atUsual(inner, static_cast<double>(cell.exposed.darker));
  m.variance = 0;
  for (std::size_t k = interval.first; k <= interval.last; ++k) {
    if (cell.number[k] == 0) continue;
    // Samples are taken to be uniform within their class, a quarter of an octave.
    constexpr double kWithin = 0.1733 * 0.1733 / 12;
    const double n = cell.number[k], mean = static_cast<double>(cell.sum[k]) / n, d = mean - inner;
    m.variance += n / number * (d * d + kWithin * mean * mean);
  }
  return m;
}

}  // namespace fathom::lighting

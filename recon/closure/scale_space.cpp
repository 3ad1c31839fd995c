#include "recon/closure/scale_space.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <tuple>

#include "realtime/base/numbers/portable_math.hpp"

namespace fathom::closure {
namespace {

constexpr double kSigma = 1.6;       // of an octave's first image [px of the octave]
constexpr double kCamera = 0.5;      // blur of an image as it comes [px]
constexpr double kReach = 4;         // of a blur, in standard deviations
constexpr int kLeastSide = 16;       // of an octave [px]
constexpr int kBorder = 5;           // without extrema [px of the octave]
constexpr double kWhite = 255;       // values are 0 to this
constexpr double kLongest = 10;      // greatest ratio of the two curvatures: more is an edge
constexpr double kQuietShare = 0.5;  // of the least response: an extremum's pixel has it itself

std::vector<float> gaussian(double sigma) {
  const int radius = static_cast<int>(std::lround(kReach * sigma));
  std::vector<double> w;
  double sum = 0;
  for (int k = 0; k <= radius; ++k) {
    w.push_back(std::exp(-0.5 * k * k / (sigma * sigma)));
    sum += k == 0 ? w.back() : 2 * w.back();
  }
  std::vector<float> out;
  for (const double v : w) out.push_back(static_cast<float>(v / sum));
  return out;
}

// The gradients' columns, or rows, within `reach` of a place, with what a Gaussian weighs them by.
struct Surroundings {
  int first = 0;
  std::size_t count = 0;
  std::array<float, 48> offset{}, weight{};  // [px of the octave], [1]

  // `side`: of the octave; its border has no gradients.
  Surroundings(double centre, double reach, double sigma, int side) {
    first = std::max(static_cast<int>(std::ceil((centre - reach) / 2)), 1);
    const int last = std::min(static_cast<int>(std::floor((centre + reach) / 2)), (side - 2) / 2);
    count = std::min(static_cast<std::size_t>(std::max(last - first + 1, 0)), weight.size());
    for (std::size_t k = 0; k < count; ++k) {
      const double off = 2 * (first + static_cast<double>(k)) - centre;
      offset[k] = static_cast<float>(off);
      weight[k] = static_cast<float>(std::exp(-0.5 * off * off / (sigma * sigma)));
    }
  }
};

// Pixels of the image in one of the octave.
double scaleOf(int octave) {
  return std::ldexp(0.5, octave);
}

constexpr double kQuarter = 0.25;  // a pixel of the doubled image is off the place of half its number [px]

// Pixel of the octave.
double placeIn(float place, double scale) {
  return (static_cast<double>(place) + kQuarter) / scale;
}

// The pixel of an image of `n` that a place beyond its border mirrors.
int mirrored(int i, int n) {
  return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i;
}

}  // namespace

ScaleSpace::ScaleSpace(double contrast) : kernels_(scale::fastestKernels()), contrast_(contrast) {
  weights_[0] = gaussian(std::sqrt(kSigma * kSigma - 4 * kCamera * kCamera));
  const double step = powerOfTwo(1.0 / kLayers);
  double before = kSigma;
  for (std::size_t k = 1; k < weights_.size(); ++k) {
    const double now = before * step;
    weights_[k] = gaussian(std::sqrt(now * now - before * before));
    before = now;
  }
}

void ScaleSpace::blur(const Octave& octave, const std::vector<float>& in, const std::vector<float>& weights,
                      std::vector<float>& out) {
  const int w = octave.width, h = octave.height, radius = static_cast<int>(weights.size()) - 1;
  out.resize(octave.at(0, h));
  padded_.resize(static_cast<std::size_t>(w + 2 * radius));
  rows_.resize(static_cast<std::size_t>(2 * radius + 1));
  float* const middle = padded_.data() + radius;
  for (int y = 0; y < h; ++y) {
    for (int k = -radius; k <= radius; ++k)
      rows_[static_cast<std::size_t>(radius + k)] = in.data() + octave.at(0, mirrored(y + k, h));
    kernels_.blurDown(rows_.data(), weights.data(), radius, w, middle);
    for (int k = 1; k <= radius; ++k) {
      middle[-k] = middle[mirrored(-k, w)];
      middle[w - 1 + k] = middle[mirrored(w - 1 + k, w)];
    }
    kernels_.blurAlong(middle, weights.data(), radius, w, out.data() + octave.at(0, y));
  }
}

void ScaleSpace::build(const ImageView& image) {
  const auto rowOf = [&](int y) {
    return static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(y) * image.stride;
  };
  used_ = 0;
  for (int w = 2 * image.width, h = 2 * image.height; std::min(w, h) >= kLeastSide; w /= 2, h /= 2) {
    if (octaves_.size() == used_) octaves_.emplace_back();
    Octave& octave = octaves_[used_];
    octave.width = w, octave.height = h;
    if (used_ == 0) {
      // Between pixels: three parts of the nearer pixel, one of the farther.
      doubled_.resize(octave.at(0, h));
      padded_.resize(static_cast<std::size_t>(image.width + 2));
      for (int y = 0; y < h; ++y) {
        const std::uint8_t *near = rowOf(y / 2),
                           *far = rowOf(std::clamp(y / 2 + (y % 2 == 0 ? -1 : 1), 0, image.height - 1));
        float* const mixed = padded_.data() + 1;
        for (int x = 0; x < image.width; ++x) mixed[x] = static_cast<float>(3 * near[x] + far[x]) / 16;
        mixed[-1] = mixed[0], mixed[image.width] = mixed[image.width - 1];
        float* const out = &doubled_[octave.at(0, y)];
        for (int x = 0; x < image.width; ++x) {
          out[2 * x] = 3 * mixed[x] + mixed[x - 1];
          out[2 * x + 1] = 3 * mixed[x] + mixed[x + 1];
        }
      }
      blur(octave, doubled_, weights_[0], octave.blurred[0]);
    } else {
      const Octave& before = octaves_[used_ - 1];
      octave.blurred[0].resize(octave.at(0, h));
      for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x)
          octave.blurred[0][octave.at(x, y)] = before.blurred[kLayers][before.at(2 * x, 2 * y)];
    }
    for (std::size_t k = 1; k < octave.blurred.size(); ++k) {
      const std::vector<float>&less = octave.blurred[k - 1], &more = octave.blurred[k];
      blur(octave, less, weights_[k], octave.blurred[k]);
      std::vector<float>& difference = octave.differences[k - 1];
      difference.resize(more.size());
      for (std::size_t i = 0; i < more.size(); ++i) difference[i] = more[i] - less[i];
    }
    for (std::size_t l = 0; l < kLayers; ++l) {
      Gradients& gradients = octave.gradients[l];
      const float* const from = octave.blurred[l + 1].data();
      gradients.strength.assign(octave.atGradient(0, h / 2), 0);
      gradients.turn.assign(octave.atGradient(0, h / 2), 0);
      for (int j = 1; 2 * j + 1 < h; ++j)
        kernels_.gradients(from + octave.at(2, 2 * j - 1), from + octave.at(2, 2 * j),
                           from + octave.at(2, 2 * j + 1), (w - 1) / 2 - 1,
                           &gradients.strength[octave.atGradient(1, j)],
                           &gradients.turn[octave.atGradient(1, j)]);
    }
    ++used_;
  }
}

const std::vector<KeyPoint>& ScaleSpace::detect(const ImageView& image) {
  points_.clear();
  build(image);
  for (std::size_t o = 0; o < used_; ++o) findIn(static_cast<int>(o));
  // Two pixels may lead to the same extremum.
  const auto key = [](const KeyPoint& p) { return std::make_tuple(-p.response, p.y, p.x, p.size, p.turn); };
  std::sort(points_.begin(), points_.end(),
            [&](const KeyPoint& a, const KeyPoint& b) { return key(a) < key(b); });
  points_.erase(std::unique(points_.begin(), points_.end(),
                            [&](const KeyPoint& a, const KeyPoint& b) { return key(a) == key(b); }),
                points_.end());
  return points_;
}

// Among the layers above and below.
bool ScaleSpace::Octave::isExtremum(int layer, int x, int y) const {
  const float value = difference(layer, x, y), sign = value > 0 ? 1.0F : -1.0F, most = sign * value;
  for (const int l : {layer - 1, layer + 1})
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx)
        if (sign * difference(l, x + dx, y + dy) > most) return false;
  return true;
}

void ScaleSpace::findIn(int o) {
  const Octave& octave = octaves_[static_cast<std::size_t>(o)];
  const auto quiet = static_cast<float>(kQuietShare * contrast_ / kLayers * kWhite);
  const int n = octave.width - 2 * kBorder;
  columns_.resize(static_cast<std::size_t>(std::max(n, 0)));
  for (int layer = 1; layer <= kLayers; ++layer)
    for (int y = kBorder; y < octave.height - kBorder; ++y) {
      const float* const row = &octave.differences[static_cast<std::size_t>(layer)][octave.at(kBorder, y)];
      const int found =
          kernels_.extrema(row - octave.width, row, row + octave.width, quiet, n, columns_.data());
      for (int k = 0; k < found; ++k) {
        const int x = kBorder + columns_[static_cast<std::size_t>(k)];
        if (octave.isExtremum(layer, x, y)) refine(o, layer, x, y);
      }
    }
}

// Lowe 2004, section 4: the extremum of the parabola through the neighbours, with an offset of at most half
// a pixel and half a layer; what is weak, or an edge, is left out.
void ScaleSpace::refine(int o, int layer, int x, int y) {
  const Octave& octave = octaves_[static_cast<std::size_t>(o)];
  constexpr int kMaxSteps = 5;
  Eigen::Vector3d gradient, offset;
  Eigen::Matrix3d curvature;
  for (int step = 0;; ++step) {
    if (step == kMaxSteps || layer < 1 || layer > kLayers || x < kBorder || x >= octave.width - kBorder ||
        y < kBorder || y >= octave.height - kBorder)
      return;
    const auto d = [&](int l, int dx, int dy) {
      return static_cast<double>(octave.difference(layer + l, x + dx, y + dy));
    };
    const double middle = d(0, 0, 0);
    gradient =
        0.5 * Eigen::Vector3d(d(0, 1, 0) - d(0, -1, 0), d(0, 0, 1) - d(0, 0, -1), d(1, 0, 0) - d(-1, 0, 0));
    const double xy = 0.25 * (d(0, 1, 1) - d(0, -1, 1) - d(0, 1, -1) + d(0, -1, -1)),
                 xl = 0.25 * (d(1, 1, 0) - d(1, -1, 0) - d(-1, 1, 0) + d(-1, -1, 0)),
                 yl = 0.25 * (d(1, 0, 1) - d(1, 0, -1) - d(-1, 0, 1) + d(-1, 0, -1));
    curvature << d(0, 1, 0) + d(0, -1, 0) - 2 * middle, xy, xl,  //
        xy, d(0, 0, 1) + d(0, 0, -1) - 2 * middle, yl,           //
        xl, yl, d(1, 0, 0) + d(-1, 0, 0) - 2 * middle;
    offset = curvature.inverse() * -gradient;
    if (!offset.allFinite()) return;
    if ((offset.cwiseAbs().array() < 0.5).all()) break;
    constexpr double kFar = 1e6;
    if ((offset.cwiseAbs().array() > kFar).any()) return;
    x += static_cast<int>(std::lround(offset.x()));
    y += static_cast<int>(std::lround(offset.y()));
    layer += static_cast<int>(std::lround(offset.z()));
  }
  const double response =
      std::abs(static_cast<double>(octave.difference(layer, x, y)) + 0.5 * gradient.dot(offset)) / kWhite;
  if (response * kLayers < contrast_) return;
  const double trace = curvature(0, 0) + curvature(1, 1),
               determinant = curvature(0, 0) * curvature(1, 1) - curvature(0, 1) * curvature(0, 1);
  if (determinant <= 0 || trace * trace * kLongest >= (kLongest + 1) * (kLongest + 1) * determinant) return;

  const double scale = scaleOf(o);
  KeyPoint point;
  point.x = static_cast<float>(scale * (x + offset.x()) - kQuarter);
  point.y = static_cast<float>(scale * (y + offset.y()) - kQuarter);
  point.size = static_cast<float>(scale * 2 * kSigma * powerOfTwo((layer + offset.z()) / kLayers));
  point.response = static_cast<float>(response);
  point.octave = o, point.layer = layer;
  addTurns(point);
}

// Lowe 2004, section 5: the directions in which the gradients around it are the strongest.
void ScaleSpace::addTurns(KeyPoint point) {
  constexpr int kBins = 36;
  constexpr double kWindow = 1.5, kSpan = 3;  // in sigmas of the key point; of the window
  constexpr float kAlso = 0.8F;               // of the strongest: a direction of its own
  const Octave& octave = octaves_[static_cast<std::size_t>(point.octave)];
  const Gradients& gradients = octave.gradients[static_cast<std::size_t>(point.layer - 1)];
  const double scale = scaleOf(point.octave), sigma = kWindow * 0.5 * static_cast<double>(point.size) / scale;
  const Surroundings columns(placeIn(point.x, scale), kSpan * sigma, sigma, octave.width),
      rows(placeIn(point.y, scale), kSpan * sigma, sigma, octave.height);

  std::array<float, kBins> raw{}, bins{};
  for (std::size_t j = 0; j < rows.count; ++j) {
    const std::size_t row = octave.atGradient(columns.first, rows.first + static_cast<int>(j));
    for (std::size_t i = 0; i < columns.count; ++i) {
      const auto bin = static_cast<int>(gradients.turn[row + i] * kBins + 0.5F) % kBins;
      raw[static_cast<std::size_t>(bin)] += columns.weight[i] * rows.weight[j] * gradients.strength[row + i];
    }
  }
  const auto rawAt = [&](int k) { return raw[static_cast<std::size_t>((k + kBins) % kBins)]; };
  for (int k = 0; k < kBins; ++k)
    bins[static_cast<std::size_t>(k)] =
        (rawAt(k - 2) + rawAt(k + 2) + 4 * (rawAt(k - 1) + rawAt(k + 1)) + 6 * rawAt(k)) / 16;

  const float enough = kAlso * *std::max_element(bins.begin(), bins.end());
  for (int k = 0; k < kBins; ++k) {
    const float now = bins[static_cast<std::size_t>(k)],
                before = bins[static_cast<std::size_t>((k + kBins - 1) % kBins)],
                after = bins[static_cast<std::size_t>((k + 1) % kBins)];
    if (!(now > before && now > after && now >= enough)) continue;
    const float at = static_cast<float>(k) + 0.5F * (before - after) / (before - 2 * now + after);
    point.turn = at / kBins;
    point.turn -= std::floor(point.turn);
    points_.push_back(point);
  }
}

// Lowe 2004, section 6.
void ScaleSpace::describe(const KeyPoint& point, std::span<float, kDescriptor> histogram) const {
  constexpr int kPlaces = 4, kTurns = 8;
  constexpr double kPlace = 3;                      // side of a place, in sigmas of the key point
  constexpr float kMost = 0.2F;                     // of the descriptor's norm, in one bin
  constexpr int kRow = kTurns, kAll = kPlaces + 2;  // with a place more around, which is left out
  const Octave& octave = octaves_[static_cast<std::size_t>(point.octave)];
  const Gradients& gradients = octave.gradients[static_cast<std::size_t>(point.layer - 1)];
  const double scale = scaleOf(point.octave), side = kPlace * 0.5 * static_cast<double>(point.size) / scale,
               reach = std::numbers::sqrt2 * 0.5 * (kPlaces + 1) * side, sigma = 0.5 * kPlaces * side;
  const Surroundings columns(placeIn(point.x, scale), reach, sigma, octave.width),
      rows(placeIn(point.y, scale), reach, sigma, octave.height);
  const double direction = 2 * std::numbers::pi * static_cast<double>(point.turn);
  const auto cosine = static_cast<float>(std::cos(direction) / side),
             sine = static_cast<float>(std::sin(direction) / side);

  std::array<float, kAll * kAll * kRow> sums{};
  constexpr float kMiddle = 0.5F * kPlaces + 0.5F, kEnd = kPlaces + 1;
  for (std::size_t j = 0; j < rows.count; ++j) {
    const std::size_t first = octave.atGradient(columns.first, rows.first + static_cast<int>(j));
    const float *strength = &gradients.strength[first], *turn = &gradients.turn[first];
    const float down_sine = rows.offset[j] * sine, down_cosine = rows.offset[j] * cosine;
    for (std::size_t i = 0; i < columns.count; ++i) {
      const float column = columns.offset[i] * cosine - down_sine + kMiddle,
                  row = columns.offset[i] * sine + down_cosine + kMiddle;
      if (!(column > 0 && column < kEnd && row > 0 && row < kEnd)) continue;
      const float value = strength[i] * rows.weight[j] * columns.weight[i];
      float ahead = (turn[i] - point.turn) * kTurns;
      if (ahead < 0) ahead += kTurns;
      // Shared among the two nearest places across and down, and the two nearest directions.
      const auto r = static_cast<int>(row), c = static_cast<int>(column), t = static_cast<int>(ahead);
      const float of_r = row - static_cast<float>(r), of_c = column - static_cast<float>(c),
                  of_t = ahead - static_cast<float>(t);
      const int t0 = t % kTurns, t1 = (t + 1) % kTurns;
      float* const corner = &sums[static_cast<std::size_t>((r * kAll + c) * kRow)];
      const float down = value * of_r, up = value - down;
      const float down_right = down * of_c, down_left = down - down_right, up_right = up * of_c,
                  up_left = up - up_right;
      const auto add = [&](float* bins, float part) {
        const float next = part * of_t;
        bins[t0] += part - next;
        bins[t1] += next;
      };
      add(corner, up_left);
      add(corner + kRow, up_right);
      add(corner + kAll * kRow, down_left);
      add(corner + (kAll + 1) * kRow, down_right);
    }
  }

  float square = 0;
  for (int r = 0; r < kPlaces; ++r)
    for (int c = 0; c < kPlaces; ++c)
      for (int t = 0; t < kTurns; ++t) {
        const float v = sums[static_cast<std::size_t>(((r + 1) * kAll + c + 1) * kRow + t)];
        histogram[static_cast<std::size_t>((r * kPlaces + c) * kTurns + t)] = v;
        square += v * v;
      }
  const float most = kMost * std::sqrt(square);
  for (float& v : histogram) v = std::min(v, most);
}

}  // namespace fathom::closure

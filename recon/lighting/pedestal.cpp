#include "recon/lighting/pedestal.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::lighting {
namespace {

constexpr float kPerOctave = 2;

}  // namespace

void Pedestal::add(float expected, float ratio) {
  constexpr float kGross = 3;  // times what was expected: a fish, a glint
  if (!(expected > 0) || !(ratio < kGross)) return;
  const float at = std::round(-kPerOctave * std::log2(expected));
  const auto k = static_cast<std::size_t>(std::clamp(at, 0.0F, static_cast<float>(kClasses - 1)));
  count_[k] += 1, expected_[k] += expected, sum_[k] += ratio, squares_[k] += ratio * ratio;
}

void Pedestal::solve() {
  constexpr double kFewest = 200;  // nodes of a class
  constexpr double kAlike = 50;    // nodes that share their ground with others
  constexpr double kOther = 0.15;  // relative: other ground has other contrast
  constexpr double kUsual = 0.02;  // prior, about 0: parts of full scale
  double w = 0, wx = 0, wy = 0, wxx = 0, wxy = 0, least = 1;
  for (std::size_t k = 0; k < count_.size(); ++k) {
    const double n = count_[k];
    if (n < kFewest) continue;
    const double mean = sum_[k] / n, variance = squares_[k] / n - mean * mean;
    if (!(variance > 0)) continue;
    const double contrast = std::sqrt(variance), m = expected_[k] / n;
    const double weight = 1 / (variance * (kAlike / (2 * n) + kOther * kOther));
    w += weight, wx += weight / m, wy += weight * contrast;
    wxx += weight / (m * m), wxy += weight * contrast / m;
    least = std::min(least, m);
  }
  level_ = 0;
  if (w == 0) return;
  // contrast = c0 - (c0 b) / m; the prior holds c0 b by the contrast that is usual here.
  const double usual = wy / w * kUsual;
  const double slope = (wxy - wx * wy / w) / (wxx - wx * wx / w + 1 / (usual * usual));
  const double at_full = (wy - slope * wx) / w;
  constexpr double kMost = 0.8;  // of the darkest class
  if (at_full > 0) level_ = static_cast<float>(std::clamp(-slope / at_full, 0.0, kMost * least));
}

void Pedestal::halve() {
  for (std::size_t k = 0; k < count_.size(); ++k)
    count_[k] /= 2, expected_[k] /= 2, sum_[k] /= 2, squares_[k] /= 2;
}

}  // namespace fathom::lighting

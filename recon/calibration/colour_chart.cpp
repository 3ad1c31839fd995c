#include "recon/calibration/colour_chart.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/colour.hpp"

namespace fathom::calibration {
namespace {

struct Patch {
  const char* name;
  Rgb srgb;
};
constexpr std::array<Patch, kPatches> kChart{
    {{"dark skin", {115, 82, 68}},   {"light skin", {194, 150, 130}},  {"blue sky", {98, 122, 157}},
     {"foliage", {87, 108, 67}},     {"blue flower", {133, 128, 177}}, {"bluish green", {103, 189, 170}},
     {"orange", {214, 126, 44}},     {"purplish blue", {80, 91, 166}}, {"moderate red", {193, 90, 99}},
     {"purple", {94, 60, 108}},      {"yellow green", {157, 188, 64}}, {"orange yellow", {224, 163, 46}},
     {"blue", {56, 61, 150}},        {"green", {70, 148, 73}},         {"red", {175, 54, 60}},
     {"yellow", {231, 199, 31}},     {"magenta", {187, 86, 149}},      {"cyan", {8, 133, 161}},
     {"white", {243, 243, 242}},     {"neutral 8", {200, 200, 200}},   {"neutral 6.5", {160, 160, 160}},
     {"neutral 5", {122, 122, 121}}, {"neutral 3.5", {85, 85, 85}},    {"black", {52, 52, 52}}}};

double column(int patch) {
  return patch % kChartColumns / (kChartColumns - 1.0) - 0.5;
}
double row(int patch) {
  const int whole = patch / kChartColumns;
  return whole / (kChartRows - 1.0) - 0.5;
}

// Factors on a view's samples: a gain for each channel, and light that varies over the chart.
struct Balance {
  Eigen::Vector3d log_gain = Eigen::Vector3d::Zero();
  double across = 0, down = 0;
  [[nodiscard]] Eigen::Vector3d of(const Eigen::Vector3d& seen, int patch) const {
    return seen.cwiseProduct((log_gain.array() + across * column(patch) + down * row(patch)).exp().matrix());
  }
};

// Balance by which `matrix` takes the view's colours to the chart's.
Balance balanceOf(const ChartView& view, const Eigen::Matrix3d& matrix) {
  const Eigen::Matrix3d inverse = matrix.inverse();
  Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
  Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
  for (int k = 0; k < kPatches; ++k) {
    const auto& seen = view.patches[static_cast<std::size_t>(k)];
    if (!seen) continue;
    const Eigen::Vector3d expected = inverse * patchColour(k);
    for (int c = 0; c < 3; ++c) {
      constexpr double kDark = 0.02;  // linear: noise and stray light
      if (expected(c) < kDark || !((*seen)(c) > 0)) continue;
      Eigen::Matrix<double, 5, 1> factors = Eigen::Matrix<double, 5, 1>::Zero();
      factors(c) = 1, factors(3) = column(k), factors(4) = row(k);
      normal += factors * factors.transpose();
      right += factors * std::log(expected(c) / (*seen)(c));
    }
  }
  normal.diagonal().array() += 1e-9;
  const Eigen::Matrix<double, 5, 1> x = normal.ldlt().solve(right);
  return {x.head<3>(), x(3), x(4)};
}

Eigen::Matrix3d colourMatrixOf(const std::vector<ChartView>& views, const std::vector<Balance>& balances) {
  Eigen::Matrix3d out;
  for (int i = 0; i < 3; ++i) {
    // The row adds up to 1: its own element is 1 less the other two.
    const int a = (i + 1) % 3, b = (i + 2) % 3;
    Eigen::Matrix2d normal = 1e-9 * Eigen::Matrix2d::Identity();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (std::size_t v = 0; v < views.size(); ++v)
      for (int k = 0; k < kPatches; ++k) {
        const auto& seen = views[v].patches[static_cast<std::size_t>(k)];
        if (!seen) continue;
        const Eigen::Vector3d colour = balances[v].of(*seen, k);
        constexpr double kFloor = 0.05;  // linear
        const double weight = 1 / (patchColour(k).mean() + kFloor);
        const Eigen::Vector2d factors(colour(a) - colour(i), colour(b) - colour(i));
        normal += weight * weight * factors * factors.transpose();
        right += weight * weight * factors * (patchColour(k)(i) - colour(i));
      }
    const Eigen::Vector2d x = normal.ldlt().solve(right);
    out(i, i) = 1 - x.sum(), out(i, a) = x(0), out(i, b) = x(1);
  }
  return out;
}

void chartErrors(const std::vector<ChartView>& views, const std::vector<Balance>& balances,
                 const Eigen::Matrix3d& matrix, std::array<double, kPatches>& errors) {
  for (int k = 0; k < kPatches; ++k) {
    double sum = 0, count = 0;
    for (std::size_t v = 0; v < views.size(); ++v)
      if (const auto& seen = views[v].patches[static_cast<std::size_t>(k)]) {
        const Eigen::Vector3d colour = (matrix * balances[v].of(*seen, k)).cwiseMax(0);
        sum += ciede2000(labOf(patchColour(k)), labOf(colour));
        count += 1;
      }
    errors[static_cast<std::size_t>(k)] = count > 0 ? sum / count : std::numeric_limits<double>::quiet_NaN();
  }
}

std::vector<double> known(const std::array<double, kPatches>& errors) {
  std::vector<double> out;
  std::copy_if(errors.begin(), errors.end(), std::back_inserter(out),
               [](double e) { return !std::isnan(e); });
  return out;
}

}  // namespace

const char* patchName(int patch) {
  return kChart[static_cast<std::size_t>(patch)].name;
}

Eigen::Vector3d patchColour(int patch) {
  const Rgb& srgb = kChart[static_cast<std::size_t>(patch)].srgb;
  return {linearFromSrgb(srgb[0] / 255.0), linearFromSrgb(srgb[1] / 255.0), linearFromSrgb(srgb[2] / 255.0)};
}

ColourCalibration calibrateColours(const std::vector<ChartView>& views, const std::string& source) {
  if (views.empty()) throw InputError(source, "", "shows no chart");
  for (const ChartView& view : views) {
    const auto left = std::count_if(view.patches.begin(), view.patches.end(),
                                    [](const auto& patch) { return patch.has_value(); });
    if (left < kFewestPatches)
      throw InputError(view.name, "",
                       "only " + std::to_string(left) + " patches are not clipped; expose less, " +
                           std::to_string(kFewestPatches) + " are needed");
  }
  ColourCalibration out;
  std::vector<Balance> balances(views.size());
  const auto balance = [&] {
    for (std::size_t v = 0; v < views.size(); ++v) balances[v] = balanceOf(views[v], out.matrix);
  };
  balance();
  chartErrors(views, balances, out.matrix, out.before);
  constexpr int kTurns = 30;
  for (int turn = 0; turn < kTurns; ++turn) {
    out.matrix = colourMatrixOf(views, balances);
    balance();
  }
  chartErrors(views, balances, out.matrix, out.after);
  const std::vector<double> after = known(out.after);
  out.median_before = median(known(out.before));
  out.median_after = median(after);
  out.worst_after = *std::max_element(after.begin(), after.end());
  return out;
}

}  // namespace fathom::calibration

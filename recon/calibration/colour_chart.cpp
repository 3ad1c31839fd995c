#include "recon/calibration/colour_chart.hpp"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
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

// Places of a patch on the chart, -0.5 to 0.5.
double column(int patch) {
  return patch % kChartColumns / (kChartColumns - 1.0) - 0.5;
}
double row(int patch) {
  const int whole = patch / kChartColumns;
  return whole / (kChartRows - 1.0) - 0.5;
}

// What turns the camera's colours of the patches into a view's samples: backscatter of each channel, as
// a share of its darkest sample; the logarithm of its gain; those of the light, which varies over the chart
// as a quadric, and of the backscatter, which varies along it; and that of an exponent, where an 8-bit
// image's tone curve is unknown.
constexpr int kBackscatter = 0, kGain = 3, kLight = 6, kHaze = 11, kTone = 13, kOfView = 14, kOfMatrix = 6;
struct Balance {
  std::array<double, kOfView> values{};
  Eigen::Vector3d darkest = Eigen::Vector3d::Ones();
};

Eigen::Vector3d balanced(const double* values, const Eigen::Vector3d& darkest, const Eigen::Vector3d& seen,
                         int patch) {
  const double u = column(patch), v = row(patch), tone = std::exp(values[kTone]);
  const double* light = values + kLight;
  const double over_chart =
      light[0] * u + light[1] * v + light[2] * u * v + light[3] * u * u + light[4] * v * v;
  const double haze = std::exp(values[kHaze] * u + values[kHaze + 1] * v);
  Eigen::Vector3d out;
  for (int c = 0; c < 3; ++c)
    out(c) = (std::pow(seen(c), tone) - values[kBackscatter + c] * haze * std::pow(darkest(c), tone)) *
             std::exp(values[kGain + c] + over_chart);
  return out;
}

// Each row adds up to 1: its own element is 1 less the other two.
Eigen::Matrix3d colourMatrixOf(const double* m) {
  Eigen::Matrix3d out;
  out << 1 - m[0] - m[1], m[0], m[1], m[2], 1 - m[2] - m[3], m[3], m[4], m[5], 1 - m[4] - m[5];
  return out;
}

// Lab of a patch as corrected less the known one.
struct PatchResidual {
  Eigen::Vector3d darkest, seen;
  int patch;
  Eigen::Vector3d known_lab;
  bool operator()(const double* view, const double* matrix, double* residual) const {
    Eigen::Map<Eigen::Vector3d>{residual} =
        labOf(colourMatrixOf(matrix) * balanced(view, darkest, seen, patch)) - known_lab;
    return true;
  }
};
// Keeps what patches do not determine near zero. Weights are far below those of the patches.
template <int kValues>
struct Prior {
  int first;
  bool operator()(const double* values, double* residual) const {
    constexpr double kPerUnit = 4;  // CIELAB units
    for (int i = 0; i < kValues; ++i) residual[i] = kPerUnit * values[first + i];
    return true;
  }
};

class ChartFit {
 public:
  // Patch `left_out` has no part in the fit.
  ChartFit(const std::vector<ChartView>& views, int left_out)
      : views_(views), left_out_(left_out), balances_(views.size()) {}

  // Least squares of all views from this share of backscatter, without the matrix and with it; returns the
  // cost.
  double solve(double backscatter) {
    (void)minimise(backscatter, true);
    before_ = errors();
    return minimise(backscatter, false);
  }
  [[nodiscard]] Eigen::Matrix3d matrix() const { return colourMatrixOf(matrix_.data()); }
  // CIEDE2000 by patch, mean over views: with the views' balances alone, and with the matrix.
  [[nodiscard]] const std::array<double, kPatches>& before() const { return before_; }
  [[nodiscard]] std::array<double, kPatches> errors() const {
    std::array<double, kPatches> out{};
    for (int k = 0; k < kPatches; ++k) {
      double sum = 0, count = 0;
      for (std::size_t v = 0; v < views_.size(); ++v)
        if (const auto& seen = views_[v].patches[static_cast<std::size_t>(k)]) {
          const Balance& b = balances_[v];
          const Eigen::Vector3d colour = matrix() * balanced(b.values.data(), b.darkest, *seen, k);
          sum += ciede2000(labOf(patchColour(k)), labOf(colour.cwiseMax(0)));
          count += 1;
        }
      out[static_cast<std::size_t>(k)] = count > 0 ? sum / count : std::numeric_limits<double>::quiet_NaN();
    }
    return out;
  }

 private:
  static void start(const ChartView& view, double backscatter, Balance& out) {
    out = {};
    Eigen::Vector3d brightest = Eigen::Vector3d::Zero();
    for (const auto& seen : view.patches) {
      if (!seen) continue;
      out.darkest = out.darkest.cwiseMin(seen->cwiseMax(kLeastSample));
      brightest = brightest.cwiseMax(*seen);
    }
    constexpr double kWhite = 0.85;
    for (int c = 0; c < 3; ++c) {
      out.values[static_cast<std::size_t>(kBackscatter + c)] = backscatter;
      out.values[static_cast<std::size_t>(kGain + c)] =
          std::log(kWhite / (brightest(c) - backscatter * out.darkest(c)));
    }
  }

  double minimise(double backscatter, bool balance_alone) {
    matrix_ = {};
    for (std::size_t v = 0; v < views_.size(); ++v) start(views_[v], backscatter, balances_[v]);
    constexpr double kLoss = 6, kMostBackscatter = 0.98;  // CIELAB units; share of the darkest sample
    ceres::Problem problem;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      double* view = balances_[v].values.data();
      for (int k = 0; k < kPatches; ++k)
        if (const auto& seen = views_[v].patches[static_cast<std::size_t>(k)]; seen && k != left_out_)
          problem.AddResidualBlock(
              new ceres::NumericDiffCostFunction<PatchResidual, ceres::CENTRAL, 3, kOfView, kOfMatrix>(
                  new PatchResidual{balances_[v].darkest, seen->cwiseMax(kLeastSample), k,
                                    labOf(patchColour(k))}),
              new ceres::CauchyLoss(kLoss), view, matrix_.data());
      using OfLight = Prior<kOfView - kLight>;
      problem.AddResidualBlock(
          new ceres::NumericDiffCostFunction<OfLight, ceres::CENTRAL, kOfView - kLight, kOfView>(
              new OfLight{kLight}),
          nullptr, view);
      for (int c = 0; c < 3; ++c) {
        problem.SetParameterLowerBound(view, kBackscatter + c, 0);
        problem.SetParameterUpperBound(view, kBackscatter + c, kMostBackscatter);
      }
      if (!views_[v].rendered) problem.SetManifold(view, new ceres::SubsetManifold(kOfView, {kTone}));
    }
    using OfMatrix = Prior<kOfMatrix>;
    problem.AddResidualBlock(
        new ceres::NumericDiffCostFunction<OfMatrix, ceres::CENTRAL, kOfMatrix, kOfMatrix>(new OfMatrix{0}),
        nullptr, matrix_.data());
    if (balance_alone) problem.SetParameterBlockConstant(matrix_.data());
    ceres::Solver::Options options;
    options.max_num_iterations = 200;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return summary.final_cost;
  }

  static constexpr double kLeastSample = 1e-4;
  const std::vector<ChartView>& views_;
  int left_out_;
  std::vector<Balance> balances_;
  std::array<double, kOfMatrix> matrix_{};
  std::array<double, kPatches> before_{};
};

constexpr double kMostError = 12;  // median CIEDE2000 of patches left out
constexpr int kNone = -1;          // no patch

// The least cost of two starts: clear water, and much backscatter. Medians are left to the caller.
ColourCalibration fitted(const std::vector<ChartView>& views, int left_out) {
  ColourCalibration out;
  double least = std::numeric_limits<double>::infinity();
  for (const double backscatter : {0.0, 0.7}) {
    ChartFit fit(views, left_out);
    const double cost = fit.solve(backscatter);
    if (!(cost < least)) continue;
    least = cost;
    out.matrix = fit.matrix();
    out.before = fit.before();
    out.after = fit.errors();
  }
  return out;
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
  return {linearFromSrgb(srgb[0]), linearFromSrgb(srgb[1]), linearFromSrgb(srgb[2])};
}

std::optional<double> agreementOf(const ChartView& view) {
  std::vector<int> patches;
  for (int k = 0; k < kPatches; ++k)
    if (view.patches[static_cast<std::size_t>(k)]) patches.push_back(k);
  if (static_cast<int>(patches.size()) < kFewestPatches) return std::nullopt;
  const auto rows = static_cast<Eigen::Index>(patches.size());
  Eigen::MatrixXd known(rows, 4), seen(rows, 3);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const int k = patches[static_cast<std::size_t>(i)];
    known.row(i) << 1, patchColour(k).cwiseSqrt().transpose();
    seen.row(i) = view.patches[static_cast<std::size_t>(k)]->cwiseMax(0).cwiseSqrt().transpose();
  }
  const Eigen::MatrixXd left = seen - known * known.colPivHouseholderQr().solve(seen);
  const Eigen::MatrixXd spread = seen.rowwise() - seen.colwise().mean();
  std::array<double, 3> explained{};
  for (Eigen::Index c = 0; c < 3; ++c)
    explained[static_cast<std::size_t>(c)] =
        1 - left.col(c).squaredNorm() / std::max(spread.col(c).squaredNorm(), 1e-12);
  std::sort(explained.begin(), explained.end());
  return (explained[1] + explained[2]) / 2;
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
  ColourCalibration out = fitted(views, kNone);
  const std::vector<double> after = known(out.after);
  out.median_before = median(known(out.before));
  out.median_after = median(after);
  out.worst_after = *std::max_element(after.begin(), after.end());
  std::vector<double> held_before, held_after;
  for (std::size_t k = 0; k < kPatches; ++k) {
    if (std::isnan(out.after[k])) continue;
    const ColourCalibration others = fitted(views, static_cast<int>(k));
    held_before.push_back(others.before[k]), held_after.push_back(others.after[k]);
  }
  out.held_before = median(std::move(held_before));
  out.held_after = median(std::move(held_after));
  if (out.held_after > out.held_before || out.held_after > kMostError)
    throw InputError(
        source, "",
        formatted("patches that the matrix was not made from are %.1f off with it, %.1f without (median "
                  "CIEDE2000; at most %.0f): the camera needs none, or light and haze are too uneven; "
                  "nothing is written",
                  out.held_after, out.held_before, kMostError));
  return out;
}

}  // namespace fathom::calibration

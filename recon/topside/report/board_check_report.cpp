#include "recon/topside/report/board_check_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/symmetric_eigen.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using calibration::BoardCheck;
using calibration::BoardError;
using Json = nlohmann::ordered_json;

constexpr double kMaxZ = 0.02, kAtRange = 2.0;  // [m]
constexpr double kNearestRange = 1.0;           // [m]
constexpr double kMaxScaleError = 0.005;
constexpr double kEllipseSigmas = 3;  // of the ellipses
constexpr std::array<const char*, 3> kAxisNames{"x", "y", "z"};

double allowed(const BoardError& board) {
  const double range = std::max(board.range, kNearestRange) / kAtRange;
  return kMaxZ * range * range;
}

// Errors along one axis [mm].
std::vector<double> along(const BoardCheck& check, int axis) {
  std::vector<double> out;
  for (const BoardError& board : check.boards)
    for (const Eigen::Vector3d& e : board.errors) out.push_back(1e3 * e(axis));
  return out;
}

double largest(const std::vector<double>& values) {
  double most = 1e-3;
  for (const double v : values) most = std::max(most, std::abs(v));
  return most;
}

web::Plot scatter(const BoardCheck& check, int a, int b) {
  const std::string x = kAxisNames[static_cast<std::size_t>(a)], y = kAxisNames[static_cast<std::size_t>(b)];
  web::Plot plot{.title = x + " - " + y + ", a colour a board; line: three standard deviations",
                 .x = x + " error [mm]",
                 .y = y + " error [mm]",
                 .width = web::kThirdPage,
                 .equal = true};
  for (std::size_t v = 0; v < check.boards.size(); ++v) {
    web::Series dots{.kind = web::Series::Kind::kDots, .colour = web::distinctColour(v), .size = 1.6};
    for (const Eigen::Vector3d& e : check.boards[v].errors) dots.at.emplace_back(1e3 * e(a), 1e3 * e(b));
    plot.series.push_back(std::move(dots));
  }
  Eigen::Matrix2d covariance;
  covariance << check.covariance(a, a), check.covariance(a, b), check.covariance(b, a),
      check.covariance(b, b);
  const SymmetricEigen<2> axes = symmetricEigen<2>(1e6 * covariance);
  web::Series ellipse{.colour = web::kRed, .size = 2};
  constexpr int kCorners = 90;
  for (int i = 0; i <= kCorners; ++i) {
    const double angle = 2 * std::numbers::pi * i / kCorners;
    const Eigen::Vector2d direction(std::cos(angle), std::sin(angle));
    ellipse.at.push_back(1e3 * Eigen::Vector2d(check.mean(a), check.mean(b)) +
                         kEllipseSigmas * axes.vectors *
                             axes.values.cwiseMax(0.0).cwiseSqrt().cwiseProduct(direction));
  }
  plot.series.push_back(std::move(ellipse));
  return plot;
}

web::Plot errorsAlong(const BoardCheck& check, int axis) {
  constexpr int kBins = 41;
  const std::vector<double> values = along(check, axis);
  const double reach = largest(values);
  const std::string name = kAxisNames[static_cast<std::size_t>(axis)];
  web::Plot plot = web::histogram(
      values, -reach, reach, kBins, name + " error [mm]",
      name + ": standard deviation " + decimals(1e3 * std::sqrt(check.covariance(axis, axis)), 2) + " mm");
  plot.width = web::kThirdPage;
  return plot;
}

Json boardJson(const BoardCheck& check, const BoardVerdict& verdict,
               const std::vector<calibration::DroppedView>& dropped) {
  Json boards = Json::array(), without = Json::array();
  for (const BoardError& b : check.boards)
    boards.push_back({{"name", b.name},
                      {"range_m", b.range},
                      {"rms_m", b.rms},
                      {"max_z_m", b.max_z},
                      {"allowed_z_m", allowed(b)},
                      {"scale", b.scale}});
  for (const auto& d : dropped) without.push_back({{"name", d.name}, {"reason", d.reason}});
  for (const auto& name : check.failed)
    without.push_back({{"name", name}, {"reason", "does not triangulate"}});
  Json covariance = Json::array();
  for (int i = 0; i < 3; ++i)
    covariance.push_back({check.covariance(i, 0), check.covariance(i, 1), check.covariance(i, 2)});
  return {{"good", verdict.good},        {"verdict", verdict.lines},
          {"max_z_m", check.max_z},      {"rms_m", check.rms},
          {"scale", check.scale},        {"mean_m", {check.mean.x(), check.mean.y(), check.mean.z()}},
          {"covariance_m2", covariance}, {"boards", boards},
          {"dropped", without}};
}

web::ReportPage boardPageOf(const BoardCheck& check, const BoardVerdict& verdict,
                            const std::vector<calibration::DroppedView>& dropped) {
  web::ReportPage report(
      "Check of a stereo calibration on chessboards",
      "Corners triangulated through the rig less the board of its known size, moved rigidly onto them; left "
      "camera frame (x right, y down, z away).");
  for (const std::string& line : verdict.lines) verdict.good ? report.text(line) : report.warning(line);
  report.section("Errors");
  for (const auto& [a, b] : {std::pair(0, 2), std::pair(1, 2), std::pair(0, 1)})
    report.plot(scatter(check, a, b));
  for (int axis = 0; axis < 3; ++axis) report.plot(errorsAlong(check, axis));
  report.section("Boards");
  std::vector<web::Row> rows;
  for (const BoardError& b : check.boards)
    rows.push_back({b.name, decimals(b.range, 2), decimals(1e3 * b.rms, 2), decimals(1e3 * b.max_z, 2),
                    decimals(1e3 * allowed(b), 1), decimals(b.scale, 5)});
  report.table({"pair", "range [m]", "RMS [mm]", "largest z [mm]", "allowed [mm]", "scale"}, rows);
  report.section("Left out");
  std::vector<std::string> left_out;
  for (const auto& d : dropped) left_out.push_back(d.name + ": " + d.reason);
  for (const auto& name : check.failed) left_out.push_back(name + ": a corner does not triangulate");
  report.list(left_out);
  return report;
}

}  // namespace

BoardVerdict judge(const BoardCheck& check) {
  BoardVerdict verdict;
  const BoardError* worst = nullptr;
  for (const BoardError& b : check.boards)
    if (worst == nullptr || b.max_z / allowed(b) > worst->max_z / allowed(*worst)) worst = &b;
  const bool depth = worst != nullptr && worst->max_z <= allowed(*worst) && check.failed.empty();
  const bool scale = std::abs(check.scale - 1) <= kMaxScaleError;
  verdict.good = depth && scale;
  if (worst != nullptr)
    verdict.lines.push_back(std::string(depth ? "good" : "BAD") + ": largest z error " +
                            decimals(1e3 * worst->max_z, 1) + " mm at " + decimals(worst->range, 2) +
                            " m (allowed " + decimals(1e3 * allowed(*worst), 1) +
                            " mm: 20 mm at 2 m, as the range squared)" + (depth ? "" : "; calibrate again"));
  if (!check.failed.empty())
    verdict.lines.push_back("BAD: " + std::to_string(check.failed.size()) +
                            " boards do not triangulate: the rig does not belong to these images");
  verdict.lines.push_back(std::string(scale ? "good" : "BAD") + ": boards come out " +
                          decimals(100 * (check.scale - 1), 2) + " % too large (allowed 0.5 %)" +
                          (scale ? "" : "; check --square, or calibrate again"));
  return verdict;
}

void writeBoardCheck(const std::filesystem::path& folder, const BoardCheck& check,
                     const BoardVerdict& verdict, const std::vector<calibration::DroppedView>& dropped) {
  boardPageOf(check, verdict, dropped).write(folder / "board-check.html");
  writeFile(folder / "board-check.json", boardJson(check, verdict, dropped).dump(2) + "\n");
}

}  // namespace fathom::topside

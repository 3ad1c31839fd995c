#include "recon/topside/report/board_check_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/uncertain_pose.hpp"
#include "telemetry/web/report_fields.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using calibration::BoardCheck;
using calibration::BoardError;
using web::Fields;

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

std::vector<Fields> boardRecords(const BoardCheck& check) {
  std::vector<Fields> out;
  for (const BoardError& b : check.boards)
    out.push_back({{"name", b.name, "pair"},
                   {"range_m", b.range, "range [m]", 2},
                   {"rms_m", b.rms, "RMS [mm]", 2, 1e3},
                   {"max_z_m", b.max_z, "largest z [mm]", 2, 1e3},
                   {"allowed_z_m", allowed(b), "allowed [mm]", 1, 1e3},
                   {"scale", b.scale, "scale", 5}});
  return out;
}

std::vector<Fields> leftOutRecords(const BoardCheck& check,
                                   const std::vector<calibration::DroppedView>& dropped) {
  std::vector<Fields> out;
  for (const auto& d : dropped) out.push_back({{"name", d.name, "pair"}, {"reason", d.reason, "reason"}});
  for (const auto& name : check.failed)
    out.push_back({{"name", name, "pair"}, {"reason", "does not triangulate", "reason"}});
  return out;
}

Fields checkFields(const BoardCheck& check, const BoardVerdict& verdict,
                   const std::vector<calibration::DroppedView>& dropped) {
  web::ReportField::Json covariance;
  for (int i = 0; i < 3; ++i) covariance.push_back(web::jsonOf(check.covariance.row(i)));
  return {{"good", verdict.good},
          {"verdict", verdict.lines},
          {"max_z_m", check.max_z},
          {"rms_m", check.rms},
          {"scale", check.scale},
          {"mean_m", web::jsonOf(check.mean)},
          {"covariance_m2", covariance},
          {"boards", web::jsonOf(boardRecords(check))},
          {"dropped", web::jsonOf(leftOutRecords(check, dropped))}};
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
  web::addTable(report, boardRecords(check));
  report.section("Left out");
  web::addTable(report, leftOutRecords(check, dropped));
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
  writeFile(folder / "board-check.json", web::jsonOf(checkFields(check, verdict, dropped)).dump(2) + "\n");
}

}  // namespace fathom::topside

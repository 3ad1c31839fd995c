#include "recon/topside/report/board_check_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "realtime/kernel/text.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/svg_plot.hpp"

namespace fathom::topside {
namespace {

using calibration::BoardCheck;
using calibration::BoardError;
using Json = nlohmann::ordered_json;

constexpr double kMaxZ = 0.02, kAtRange = 2.0;  // [m]
constexpr double kNearest = 1.0;                // [m]
constexpr double kMaxScaleError = 0.005;
constexpr double kSigmas = 3;  // of the ellipses
constexpr std::array<const char*, 3> kAxes{"x", "y", "z"};

double allowed(const BoardError& board) {
  const double range = std::max(board.range, kNearest) / kAtRange;
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

std::string scatter(const BoardCheck& check, int a, int b) {
  const double reach = 1.1 * std::max(largest(along(check, a)), largest(along(check, b)));
  SvgPlot plot({.width = 300,
                .height = 300,
                .left = -reach,
                .right = reach,
                .bottom = -reach,
                .top = reach,
                .x_label = std::string(kAxes[static_cast<std::size_t>(a)]) + " error [mm]",
                .y_label = std::string(kAxes[static_cast<std::size_t>(b)]) + " error [mm]",
                .title = std::string(kAxes[static_cast<std::size_t>(a)]) + " - " +
                         kAxes[static_cast<std::size_t>(b)]});
  for (std::size_t v = 0; v < check.boards.size(); ++v) {
    std::vector<Eigen::Vector2d> dots;
    for (const Eigen::Vector3d& e : check.boards[v].errors) dots.emplace_back(1e3 * e(a), 1e3 * e(b));
    plot.dots(dots, 1.6, distinctColour(v), 0.55);
  }
  Eigen::Matrix2d covariance;
  covariance << check.covariance(a, a), check.covariance(a, b), check.covariance(b, a),
      check.covariance(b, b);
  plot.ellipse(1e3 * Eigen::Vector2d(check.mean(a), check.mean(b)), 1e6 * covariance, kSigmas, "#b3261e");
  return plot.svg();
}

std::string histogram(const BoardCheck& check, int axis) {
  constexpr int kBins = 41;
  const std::vector<double> values = along(check, axis);
  const double reach = largest(values);
  const std::string name = kAxes[static_cast<std::size_t>(axis)];
  return histogramSvg(
      values, -reach, reach, kBins, name + " error [mm]",
      name + ": standard deviation " + fixedDigits(1e3 * std::sqrt(check.covariance(axis, axis)), 2) + " mm");
}

Json toJson(const BoardCheck& check, const BoardVerdict& verdict,
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

std::string toHtml(const BoardCheck& check, const BoardVerdict& verdict, const std::string& figures,
                   const std::vector<calibration::DroppedView>& dropped) {
  std::string out = htmlHead("Check of a stereo calibration on chessboards");
  for (const std::string& line : verdict.lines)
    out += std::string("<p class=") + (verdict.good ? "good" : "bad") + ">" + markupText(line) + "</p>\n";
  out +=
      "<p>Corners triangulated through the rig less the board of its known size, moved rigidly onto them; "
      "left camera frame (x right, y down, z away). Red: three standard deviations; a colour a board.</p>\n";
  out += figures +
         "<h2>Boards</h2>\n<table><tr><th>pair</th><th>range [m]</th><th>RMS [mm]</th><th>largest z "
         "[mm]</th><th>allowed [mm]</th><th>scale</th></tr>\n";
  for (const BoardError& b : check.boards)
    out += "<tr><td>" + markupText(b.name) + "</td><td class=n>" + fixedDigits(b.range, 2) +
           "</td><td class=n>" + fixedDigits(1e3 * b.rms, 2) + "</td><td class=n>" +
           fixedDigits(1e3 * b.max_z, 2) + "</td><td class=n>" + fixedDigits(1e3 * allowed(b), 1) +
           "</td><td class=n>" + fixedDigits(b.scale, 5) + "</td></tr>\n";
  out += "</table>\n";
  if (!dropped.empty() || !check.failed.empty()) {
    out += "<h2>Left out</h2><ul>";
    for (const auto& d : dropped) out += "<li>" + markupText(d.name) + ": " + markupText(d.reason) + "</li>";
    for (const auto& name : check.failed)
      out += "<li>" + markupText(name) + ": a corner does not triangulate</li>";
    out += "</ul>\n";
  }
  return out + "</html>\n";
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
                            fixedDigits(1e3 * worst->max_z, 1) + " mm at " + fixedDigits(worst->range, 2) +
                            " m (allowed " + fixedDigits(1e3 * allowed(*worst), 1) +
                            " mm: 20 mm at 2 m, as the range squared)" + (depth ? "" : "; calibrate again"));
  if (!check.failed.empty())
    verdict.lines.push_back("BAD: " + std::to_string(check.failed.size()) +
                            " boards do not triangulate: the rig does not belong to these images");
  verdict.lines.push_back(std::string(scale ? "good" : "BAD") + ": boards come out " +
                          fixedDigits(100 * (check.scale - 1), 2) + " % too large (allowed 0.5 %)" +
                          (scale ? "" : "; check --square, or calibrate again"));
  return verdict;
}

void writeBoardCheck(const std::filesystem::path& folder, const BoardCheck& check,
                     const BoardVerdict& verdict, const std::vector<calibration::DroppedView>& dropped) {
  std::string figures;
  const std::array<std::string, 6> plots{scatter(check, 0, 2), scatter(check, 1, 2), scatter(check, 0, 1),
                                         histogram(check, 0),  histogram(check, 1),  histogram(check, 2)};
  for (const std::string& plot : plots) figures += "<figure>" + plot + "</figure>";
  figures += "\n";
  AtomicFile json(folder / "board-check.json"), html(folder / "board-check.html"), svg(folder / "errors.svg");
  json.stream() << toJson(check, verdict, dropped).dump(2) << '\n';
  html.stream() << toHtml(check, verdict, figures, dropped);
  svg.stream() << besideEachOther(plots, 3);
  json.commit();
  html.commit();
  svg.commit();
}

}  // namespace fathom::topside

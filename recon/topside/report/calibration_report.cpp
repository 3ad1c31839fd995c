#include "recon/topside/report/calibration_report.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "realtime/kernel/text.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/svg_plot.hpp"

namespace fathom::topside {
namespace {

using calibration::CalibratedView;
using calibration::Corners;
using calibration::RigCalibration;
using Json = nlohmann::ordered_json;

constexpr double kDegrees = 180.0 / std::numbers::pi;
constexpr int kCellsAcross = 8, kCellsDown = 6;
// Where less of an image than this was seen, its distortion there is guessed.
constexpr double kEnoughCoverage = 0.7;

struct Named {
  const char* name;
  double Camera::*value;
  double calibration::CameraSigma::*sigma;
  int digits;
};
constexpr Named kIntrinsics[] = {{"fx", &Camera::fx, &calibration::CameraSigma::fx, 3},
                                 {"fy", &Camera::fy, &calibration::CameraSigma::fy, 3},
                                 {"cx", &Camera::cx, &calibration::CameraSigma::cx, 3},
                                 {"cy", &Camera::cy, &calibration::CameraSigma::cy, 3},
                                 {"k1", &Camera::k1, &calibration::CameraSigma::k1, 5},
                                 {"k2", &Camera::k2, &calibration::CameraSigma::k2, 5},
                                 {"p1", &Camera::p1, &calibration::CameraSigma::p1, 5},
                                 {"p2", &Camera::p2, &calibration::CameraSigma::p2, 5},
                                 {"k3", &Camera::k3, &calibration::CameraSigma::k3, 5}};

Json cameraJson(const Camera& camera, const calibration::CameraSigma& sigma) {
  Json out{{"width_px", camera.width}, {"height_px", camera.height}};
  for (const Named& n : kIntrinsics) out[n.name] = {{"value", camera.*n.value}, {"sigma", sigma.*n.sigma}};
  return out;
}

Json triple(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

Json toJson(const RigCalibration& done, const calibration::Chessboard& board) {
  Json views = Json::array(), dropped = Json::array();
  for (const CalibratedView& v : done.views)
    views.push_back({{"name", v.name},
                     {"left_rms_px", v.left_rms},
                     {"right_rms_px", v.right_rms},
                     {"stereo_rms_px", v.stereo_rms}});
  for (const auto& d : done.dropped) dropped.push_back({{"name", d.name}, {"reason", d.reason}});
  const SE3& T = done.rig.T_right_left;
  return {{"board", {{"columns", board.columns}, {"rows", board.rows}, {"square_m", board.square}}},
          {"rms_px", {{"left", done.left_rms}, {"right", done.right_rms}, {"stereo", done.stereo_rms}}},
          {"rms_alone_px", {{"left", done.left_alone_rms}, {"right", done.right_alone_rms}}},
          {"baseline_m", {{"value", done.rig.baseline()}, {"sigma", done.sigma.baseline}}},
          {"T_right_left",
           {{"translation_m", triple(T.translation())},
            {"translation_sigma_m", triple(done.sigma.translation)},
            {"euler_rad", triple(T.euler())},
            {"rotation_sigma_rad", triple(done.sigma.rotation)}}},
          {"left", cameraJson(done.rig.left, done.sigma.left)},
          {"right", cameraJson(done.rig.right, done.sigma.right)},
          {"coverage",
           {{"left", coverage(done.views, &CalibratedView::left, done.rig.left)},
            {"right", coverage(done.views, &CalibratedView::right, done.rig.right)}}},
          {"views", views},
          {"dropped", dropped}};
}

PlotAxes imageAxes(const Camera& camera, const std::string& title) {
  constexpr double kWidth = 460;  // [px]
  return {.width = kWidth,
          .height = kWidth * camera.height / camera.width,
          .left = 0,
          .right = static_cast<double>(camera.width),
          .bottom = static_cast<double>(camera.height),
          .top = 0,
          .x_label = "u [px]",
          .y_label = "v [px]",
          .title = title};
}

std::string coveragePlot(const RigCalibration& done, const Camera& camera, Corners CalibratedView::*corners,
                         const std::string& title) {
  SvgPlot plot(imageAxes(camera, title));
  for (std::size_t v = 0; v < done.views.size(); ++v)
    plot.dots(done.views[v].*corners, 2.2, distinctColour(v), 0.8);
  return plot.svg();
}

std::string residualPlot(const RigCalibration& done, const Camera& camera, Corners CalibratedView::*corners,
                         std::vector<Eigen::Vector2d> CalibratedView::*residuals, double enlarged,
                         const std::string& title) {
  SvgPlot plot(imageAxes(camera, title));
  for (std::size_t v = 0; v < done.views.size(); ++v) {
    const CalibratedView& view = done.views[v];
    for (std::size_t k = 0; k < (view.*corners).size(); ++k)
      plot.segment((view.*corners)[k], (view.*corners)[k] + enlarged * (view.*residuals)[k],
                   distinctColour(v));
    plot.dots(view.*corners, 0.8, "#1b2733");
  }
  return plot.svg();
}

std::string viewBars(const RigCalibration& done) {
  double most = 0;
  for (const CalibratedView& v : done.views) most = std::max({most, v.left_rms, v.right_rms});
  const auto n = static_cast<double>(done.views.size());
  SvgPlot plot({.width = std::clamp(26.0 * n, 300.0, 1000.0),
                .height = 220,
                .left = 0.5,
                .right = n + 0.5,
                .bottom = 0,
                .top = 1.1 * most,
                .x_label = "view",
                .y_label = "RMS [px]",
                .title = "blue: left, red: right; line: all views together"});
  for (std::size_t v = 0; v < done.views.size(); ++v) {
    const double at = static_cast<double>(v) + 1;
    plot.rectangle({at - 0.36, 0}, {at - 0.02, done.views[v].left_rms}, "#1f77b4",
                   done.views[v].name + " left " + fixedDigits(done.views[v].left_rms, 3) + " px");
    plot.rectangle({at + 0.02, 0}, {at + 0.36, done.views[v].right_rms}, "#d62728",
                   done.views[v].name + " right " + fixedDigits(done.views[v].right_rms, 3) + " px");
  }
  plot.line({{0.5, done.stereo_rms}, {n + 0.5, done.stereo_rms}}, "#1b2733", 1.5, true);
  return plot.svg();
}

std::string pm(double value, double sigma, int digits) {
  return fixedDigits(value, digits) + " &plusmn; " + fixedDigits(sigma, digits);
}

std::string parameterTables(const RigCalibration& done) {
  std::string out = "<table><tr><th></th><th>left</th><th>right</th></tr>\n";
  for (const Named& n : kIntrinsics) {
    if (done.rig.left.*n.value == 0 && done.rig.right.*n.value == 0) continue;  // not estimated
    out += std::string("<tr><td>") + n.name + "</td><td class=n>" +
           pm(done.rig.left.*n.value, done.sigma.left.*n.sigma, n.digits) + "</td><td class=n>" +
           pm(done.rig.right.*n.value, done.sigma.right.*n.sigma, n.digits) + "</td></tr>\n";
  }
  out +=
      "</table><table><tr><th>right from left</th><th>x</th><th>y</th><th>z</th></tr>\n<tr><td>translation "
      "[mm]</td>";
  const SE3& T = done.rig.T_right_left;
  for (int i = 0; i < 3; ++i)
    out += "<td class=n>" + pm(1e3 * T.translation()(i), 1e3 * done.sigma.translation(i), 2) + "</td>";
  out += "</tr><tr><td>rotation (Euler) [deg]</td>";
  for (int i = 0; i < 3; ++i)
    out += "<td class=n>" + pm(kDegrees * T.euler()(i), kDegrees * done.sigma.rotation(i), 4) + "</td>";
  return out + "</tr></table>\n";
}

std::string toHtml(const RigCalibration& done, const calibration::Chessboard& board,
                   const std::string& name) {
  std::string out = htmlHead("Stereo calibration " + name);
  out += "<p>" + std::to_string(done.views.size()) + " pairs of a chessboard with " +
         std::to_string(board.columns) + " x " + std::to_string(board.rows) +
         " inner corners and squares of " + fixedDigits(1e3 * board.square, 2) + " mm. Stereo RMS <b>" +
         fixedDigits(done.stereo_rms, 3) + " px</b> (left " + fixedDigits(done.left_rms, 3) + ", right " +
         fixedDigits(done.right_rms, 3) + "; each camera calibrated alone " +
         fixedDigits(done.left_alone_rms, 3) + " and " + fixedDigits(done.right_alone_rms, 3) +
         "). Baseline <b>" + pm(1e3 * done.rig.baseline(), 1e3 * done.sigma.baseline, 2) +
         " mm</b>. &plusmn; is one standard deviation from the scatter of the corners; it knows nothing of a "
         "bent board or a wrong square.</p>\n";
  out += "<h2>Parameters</h2>\n" + parameterTables(done);
  const double left = coverage(done.views, &CalibratedView::left, done.rig.left);
  const double right = coverage(done.views, &CalibratedView::right, done.rig.right);
  out += "<h2>Coverage</h2>\n<p>Corners lie in " + fixedDigits(100 * left, 0) + " % (left) and " +
         fixedDigits(100 * right, 0) + " % (right) of the cells of an 8 x 6 grid over the image. ";
  out += std::min(left, right) < kEnoughCoverage
             ? "<span class=bad>That is little: where no corner lies the distortion is guessed; take pairs "
               "with the board in the empty parts.</span></p>\n"
             : "</p>\n";
  out += "<figure>" +
         coveragePlot(done, done.rig.left, &CalibratedView::left, "left: corners, a colour a view") +
         "</figure><figure>" + coveragePlot(done, done.rig.right, &CalibratedView::right, "right") +
         "</figure>\n";
  // Arrows of the RMS length become about this long in the image.
  constexpr double kArrow = 0.02;  // of the image's width
  const double enlarged =
      std::max(1.0, std::round(kArrow * done.rig.left.width / std::max(done.stereo_rms, 1e-6) / 10) * 10);
  out += "<h2>Residuals</h2>\n<p>Seen less projected, " + fixedDigits(enlarged, 0) +
         " times enlarged. They should point nowhere in particular: a pattern common to many views is "
         "distortion that the model does not hold.</p>\n<figure>" +
         residualPlot(done, done.rig.left, &CalibratedView::left, &CalibratedView::left_residuals, enlarged,
                      "left") +
         "</figure><figure>" +
         residualPlot(done, done.rig.right, &CalibratedView::right, &CalibratedView::right_residuals,
                      enlarged, "right") +
         "</figure>\n";
  out += "<h2>Views</h2>\n<figure>" + viewBars(done) +
         "</figure>\n<table><tr><th></th><th>view</th><th>left [px]</th><th>right [px]</th><th>stereo "
         "[px]</th><th>distance [m]</th></tr>\n";
  for (std::size_t v = 0; v < done.views.size(); ++v) {
    const CalibratedView& view = done.views[v];
    const Eigen::Vector3d middle(0.5 * (board.columns - 1) * board.square,
                                 0.5 * (board.rows - 1) * board.square, 0);
    out += "<tr><td class=n>" + std::to_string(v + 1) + "</td><td>" + markupText(view.name) +
           "</td><td class=n>" + fixedDigits(view.left_rms, 3) + "</td><td class=n>" +
           fixedDigits(view.right_rms, 3) + "</td><td class=n>" + fixedDigits(view.stereo_rms, 3) +
           "</td><td class=n>" + fixedDigits((view.T_left_board * middle).z(), 2) + "</td></tr>\n";
  }
  out += "</table>\n";
  if (!done.dropped.empty()) {
    out += "<h2>Dropped</h2><ul>";
    for (const auto& d : done.dropped)
      out += "<li>" + markupText(d.name) + ": " + markupText(d.reason) + "</li>";
    out += "</ul>\n";
  }
  return out + "</html>\n";
}

}  // namespace

double coverage(const std::vector<CalibratedView>& views, Corners CalibratedView::*corners,
                const Camera& camera) {
  std::set<int> cells;
  for (const CalibratedView& view : views)
    for (const Eigen::Vector2d& c : view.*corners) {
      const int x = std::clamp(static_cast<int>(c.x() / camera.width * kCellsAcross), 0, kCellsAcross - 1);
      const int y = std::clamp(static_cast<int>(c.y() / camera.height * kCellsDown), 0, kCellsDown - 1);
      cells.insert(y * kCellsAcross + x);
    }
  return static_cast<double>(cells.size()) / (kCellsAcross * kCellsDown);
}

void writeCalibrationReport(const std::filesystem::path& calib, const RigCalibration& done,
                            const calibration::Chessboard& board) {
  AtomicFile json(calib.string() + ".json"), html(calib.string() + ".html");
  json.stream() << toJson(done, board).dump(2) << '\n';
  html.stream() << toHtml(done, board, calib.filename().string());
  json.commit();
  html.commit();
}

}  // namespace fathom::topside

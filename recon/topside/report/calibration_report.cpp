#include "recon/topside/report/calibration_report.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/flat_port.hpp"
#include "recon/topside/report/json_values.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using calibration::CalibratedView;
using calibration::Corners;
using calibration::RigCalibration;
using Json = nlohmann::ordered_json;

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

// What the file says: behind a port the camera in air.
const Camera& lensOf(const Camera& camera) {
  return camera.port ? camera.port->air : camera;
}

Json portJson(const Camera& camera, const calibration::PortSigma& sigma) {
  if (!camera.port) return nullptr;
  const FlatPort& port = *camera.port;
  return {{"normal", {port.normal.x(), port.normal.y(), port.normal.z()}},
          {"normal_sigma", {sigma.normal.x(), sigma.normal.y()}},
          {"distance_m", {{"value", port.distance}, {"sigma", sigma.distance}}},
          {"glass_m", port.glass},
          {"glass_index", port.glass_index},
          {"water_index", port.water_index}};
}

Json calibrationJson(const RigCalibration& done, const std::optional<calibration::Chessboard>& board) {
  Json views = Json::array(), dropped = Json::array();
  for (const CalibratedView& v : done.views)
    views.push_back({{"name", v.name},
                     {"left_rms_px", v.left_rms},
                     {"right_rms_px", v.right_rms},
                     {"stereo_rms_px", v.stereo_rms}});
  for (const auto& d : done.dropped) dropped.push_back({{"name", d.name}, {"reason", d.reason}});
  const SE3& T = done.rig.T_right_left;
  const Json shown =
      board ? Json{{"columns", board->columns}, {"rows", board->rows}, {"square_m", board->square}} : Json();
  const Json alone =
      done.rig.left.port ? Json() : Json{{"left", done.left_alone_rms}, {"right", done.right_alone_rms}};
  return {{"board", shown},
          {"rms_px", {{"left", done.left_rms}, {"right", done.right_rms}, {"stereo", done.stereo_rms}}},
          {"rms_alone_px", alone},
          {"baseline_m", {{"value", done.rig.baseline()}, {"sigma", done.sigma.baseline}}},
          {"T_right_left",
           {{"translation_m", jsonOf(T.translation())},
            {"translation_sigma_m", jsonOf(done.sigma.translation)},
            {"euler_rad", jsonOf(T.euler())},
            {"rotation_sigma_rad", jsonOf(done.sigma.rotation)}}},
          {"left", cameraJson(lensOf(done.rig.left), done.sigma.left)},
          {"right", cameraJson(lensOf(done.rig.right), done.sigma.right)},
          {"left_port", portJson(done.rig.left, done.sigma.left_port)},
          {"right_port", portJson(done.rig.right, done.sigma.right_port)},
          {"coverage",
           {{"left", coverage(done.views, &CalibratedView::left, done.rig.left)},
            {"right", coverage(done.views, &CalibratedView::right, done.rig.right)}}},
          {"views", views},
          {"dropped", dropped}};
}

// An image's pixels, with its border.
web::Plot imagePlot(const Camera& camera, const std::string& title) {
  const double w = camera.width, h = camera.height;
  web::Series border{.colour = web::kGrey, .at = {{0, 0}, {w, 0}, {w, h}, {0, h}, {0, 0}}, .size = 0.5};
  return {.title = title,
          .x = "u [px]",
          .y = "v [px]",
          .series = {std::move(border)},
          .width = web::kHalfPage,
          .equal = true,
          .down = true};
}

web::Plot coveragePlot(const RigCalibration& done, const Camera& camera, Corners CalibratedView::*corners,
                       const std::string& title) {
  web::Plot plot = imagePlot(camera, title);
  for (std::size_t v = 0; v < done.views.size(); ++v)
    plot.series.push_back(
        {.kind = web::Series::Kind::kDots, .colour = web::distinctColour(v), .at = done.views[v].*corners});
  return plot;
}

web::Plot residualPlot(const RigCalibration& done, const Camera& camera, Corners CalibratedView::*corners,
                       std::vector<Eigen::Vector2d> CalibratedView::*residuals, double enlarged,
                       const std::string& title) {
  web::Plot plot = imagePlot(camera, title);
  web::Series from{.kind = web::Series::Kind::kDots, .colour = web::kGrey, .size = 0.8};
  for (std::size_t v = 0; v < done.views.size(); ++v) {
    const CalibratedView& view = done.views[v];
    web::Series arrows{.colour = web::distinctColour(v), .size = 1};
    for (std::size_t k = 0; k < (view.*corners).size(); ++k) {
      const Eigen::Vector2d corner = (view.*corners)[k];
      from.at.push_back(corner);
      arrows.at.insert(arrows.at.end(), {corner, corner + enlarged * (view.*residuals)[k]});
      arrows.lift();
    }
    plot.series.push_back(std::move(arrows));
  }
  plot.series.push_back(std::move(from));
  return plot;
}

web::Plot viewBars(const RigCalibration& done) {
  web::Series left{.label = "left", .kind = web::Series::Kind::kAreas, .colour = web::kBlue},
      right{.label = "right", .kind = web::Series::Kind::kAreas, .colour = web::kRed};
  for (std::size_t v = 0; v < done.views.size(); ++v) {
    const double at = static_cast<double>(v) + 1;
    left.rectangle({at - 0.36, 0}, {at - 0.02, done.views[v].left_rms});
    right.rectangle({at + 0.02, 0}, {at + 0.36, done.views[v].right_rms});
  }
  web::Series all{
      .label = "all views together",
      .colour = web::kGrey,
      .at = {{0.5, done.stereo_rms}, {static_cast<double>(done.views.size()) + 0.5, done.stereo_rms}},
      .dashed = true};
  return {.title = "RMS of each view",
          .x = "view",
          .y = "RMS [px]",
          .series = {std::move(left), std::move(right), std::move(all)}};
}

void addParameters(web::ReportPage& report, const RigCalibration& done) {
  std::vector<web::Row> rows;
  const Camera &left = lensOf(done.rig.left), &right = lensOf(done.rig.right);
  const bool ports = done.rig.left.port && done.rig.right.port;
  for (const Named& n : kIntrinsics) {
    if (left.*n.value == 0 && right.*n.value == 0) continue;  // not estimated
    if (ports)
      rows.push_back({n.name, decimals(left.*n.value, n.digits), decimals(right.*n.value, n.digits)});
    else
      rows.push_back({n.name, web::plusMinus(left.*n.value, done.sigma.left.*n.sigma, n.digits),
                      web::plusMinus(right.*n.value, done.sigma.right.*n.sigma, n.digits)});
  }
  if (ports) {
    const FlatPort &p = *done.rig.left.port, &q = *done.rig.right.port;
    const calibration::PortSigma &of_p = done.sigma.left_port, &of_q = done.sigma.right_port;
    rows.push_back({"port: distance [mm]", web::plusMinus(1e3 * p.distance, 1e3 * of_p.distance, 2),
                    web::plusMinus(1e3 * q.distance, 1e3 * of_q.distance, 2)});
    for (const Eigen::Index i : {0, 1})
      rows.push_back(
          {i == 0 ? "port: normal to the right [deg]" : "port: normal downwards [deg]",
           web::plusMinus(kDegreesPerRadian * p.normal(i), kDegreesPerRadian * of_p.normal(i), 3),
           web::plusMinus(kDegreesPerRadian * q.normal(i), kDegreesPerRadian * of_q.normal(i), 3)});
  }
  report.table({"", ports ? "left, in air" : "left", ports ? "right, in air" : "right"}, rows);
  const SE3& T = done.rig.T_right_left;
  web::Row translation{"translation [mm]"}, rotation{"rotation (Euler) [deg]"};
  for (int i = 0; i < 3; ++i) {
    translation.emplace_back(web::plusMinus(1e3 * T.translation()(i), 1e3 * done.sigma.translation(i), 2));
    rotation.emplace_back(
        web::plusMinus(kDegreesPerRadian * T.euler()(i), kDegreesPerRadian * done.sigma.rotation(i), 4));
  }
  report.table({"right from left", "x", "y", "z"}, {translation, rotation});
}

std::string summaryOf(const RigCalibration& done, const std::optional<calibration::Chessboard>& board) {
  const std::string rms = "Stereo RMS " + decimals(done.stereo_rms, 3) + " px (left " +
                          decimals(done.left_rms, 3) + ", right " + decimals(done.right_rms, 3);
  if (!board)
    return std::to_string(done.views.size()) + " pairs of a scene that stood still. " + rms +
           "). Baseline as given: " + decimals(1e3 * done.rig.baseline(), 2) +
           " mm; its error is every length's. ± is one standard deviation from the scatter of what was seen "
           "again; it knows nothing of things that moved.";
  return std::to_string(done.views.size()) + " pairs of a chessboard with " + std::to_string(board->columns) +
         " x " + std::to_string(board->rows) + " inner corners and squares of " +
         decimals(1e3 * board->square, 2) + " mm. " + rms +
         (done.rig.left.port ? "); the cameras are as they were in air"
                             : "; each camera calibrated alone " + decimals(done.left_alone_rms, 3) +
                                   " and " + decimals(done.right_alone_rms, 3) + ")") +
         ". Baseline " + web::plusMinus(1e3 * done.rig.baseline(), 1e3 * done.sigma.baseline, 2) +
         " mm. ± is one standard deviation from the scatter of the corners; it knows nothing of a bent board "
         "or a wrong square.";
}

web::ReportPage calibrationPageOf(const RigCalibration& done,
                                  const std::optional<calibration::Chessboard>& board,
                                  const std::string& name) {
  web::ReportPage report("Stereo calibration " + name, summaryOf(done, board));
  report.section("Parameters");
  addParameters(report, done);
  const double left = coverage(done.views, &CalibratedView::left, done.rig.left);
  const double right = coverage(done.views, &CalibratedView::right, done.rig.right);
  report.section("Coverage");
  report.text("Points seen are in " + decimals(100 * left, 0) + " % (left) and " + decimals(100 * right, 0) +
              " % (right) of the cells of an 8 x 6 grid over the image.");
  if (std::min(left, right) < kEnoughCoverage)
    report.warning(
        "That is little: where none is the distortion is guessed; take pairs that show something in the "
        "empty parts.");
  report.plot(coveragePlot(done, done.rig.left, &CalibratedView::left, "left: points seen, a colour a view"));
  report.plot(coveragePlot(done, done.rig.right, &CalibratedView::right, "right"));
  // Arrows of the RMS length become about this long in the image.
  constexpr double kArrow = 0.02;  // of the image's width
  const double enlarged =
      std::max(1.0, std::round(kArrow * done.rig.left.width / std::max(done.stereo_rms, 1e-6) / 10) * 10);
  report.section("Residuals");
  report.text("Seen less projected, " + decimals(enlarged, 0) +
              " times enlarged. They should point nowhere in particular: a pattern common to many views is "
              "distortion that the model does not hold.");
  report.plot(residualPlot(done, done.rig.left, &CalibratedView::left, &CalibratedView::left_residuals,
                           enlarged, "left"));
  report.plot(residualPlot(done, done.rig.right, &CalibratedView::right, &CalibratedView::right_residuals,
                           enlarged, "right"));
  report.section("Views");
  report.plot(viewBars(done));
  std::vector<web::Row> rows;
  for (std::size_t v = 0; v < done.views.size(); ++v) {
    const CalibratedView& view = done.views[v];
    rows.push_back({view.name, v + 1, decimals(view.left_rms, 3), decimals(view.right_rms, 3),
                    decimals(view.stereo_rms, 3), decimals(view.distance, 2)});
  }
  report.table({"view", "number", "left [px]", "right [px]", "stereo [px]", "distance [m]"}, rows);
  report.section("Dropped");
  std::vector<std::string> dropped;
  for (const auto& d : done.dropped) dropped.push_back(d.name + ": " + d.reason);
  report.list(dropped);
  return report;
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
                            const std::optional<calibration::Chessboard>& board) {
  calibrationPageOf(done, board, calib.filename().string()).write(calib.string() + ".html");
  writeFile(calib.string() + ".json", calibrationJson(done, board).dump(2) + "\n");
}

}  // namespace fathom::topside

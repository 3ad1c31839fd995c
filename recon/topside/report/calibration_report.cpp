#include "recon/topside/report/calibration_report.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/camera.hpp"
#include "telemetry/web/report_fields.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using calibration::CalibratedView;
using calibration::Corners;
using calibration::RigCalibration;
using web::Fields;

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

// What the file says: behind a port the camera in air.
const Camera& lensOf(const Camera& camera) {
  return camera.port ? camera.port->air : camera;
}

// A row of the page; what neither this camera nor the other has was not estimated.
Fields cameraFields(const Camera& camera, const calibration::CameraSigma& sigma, const Camera& other) {
  const Camera &lens = lensOf(camera), &other_lens = lensOf(other);
  Fields out{{"width_px", lens.width}, {"height_px", lens.height}};
  for (const Named& n : kIntrinsics) {
    const double value = lens.*n.value;
    const bool estimated = value != 0 || other_lens.*n.value != 0;
    out.emplace_back(n.name, Fields{{"value", value, estimated ? n.name : "",
                                     camera.port ? decimals(value, n.digits)
                                                 : web::plusMinus(value, sigma.*n.sigma, n.digits)},
                                    {"sigma", sigma.*n.sigma}});
  }
  return out;
}

Fields portFields(const Camera& camera, const calibration::PortSigma& sigma) {
  if (!camera.port) return {};
  const FlatPort& port = *camera.port;
  const auto turned = [&](Eigen::Index i) {
    return web::plusMinus(kDegreesPerRadian * port.normal(i), kDegreesPerRadian * sigma.normal(i), 3);
  };
  return {{"normal", web::jsonOf(port.normal), "port: normal to the right, downwards [deg]",
           turned(0) + ", " + turned(1)},
          {"normal_sigma", web::jsonOf(sigma.normal)},
          {"distance_m", Fields{{"value", port.distance, "port: distance [mm]",
                                 web::plusMinus(1e3 * port.distance, 1e3 * sigma.distance, 2)},
                                {"sigma", sigma.distance}}},
          {"glass_m", port.glass},
          {"glass_index", port.glass_index},
          {"water_index", port.water_index}};
}

std::vector<Fields> viewRecords(const RigCalibration& done) {
  std::vector<Fields> out;
  for (const CalibratedView& v : done.views)
    out.push_back(web::named("number", std::to_string(out.size() + 1),
                             {{"name", v.name, "view"},
                              {"left_rms_px", v.left_rms, "left [px]", 3},
                              {"right_rms_px", v.right_rms, "right [px]", 3},
                              {"stereo_rms_px", v.stereo_rms, "stereo [px]", 3},
                              {"", v.distance, "distance [m]", 2}}));
  return out;
}

std::vector<Fields> droppedRecords(const RigCalibration& done) {
  std::vector<Fields> out;
  for (const auto& d : done.dropped)
    out.push_back({{"name", d.name, "view"}, {"reason", d.reason, "reason"}});
  return out;
}

Fields boardFields(const std::optional<calibration::Chessboard>& board) {
  if (!board) return {};
  return {{"columns", board->columns, "inner corners of the chessboard in a row"},
          {"rows", board->rows, "and in a column"},
          {"square_m", board->square, "its squares [mm]", 2, 1e3}};
}

// The file; what has a title is in the page's first table.
Fields calibrationFields(const RigCalibration& done, const std::optional<calibration::Chessboard>& board) {
  const Camera &left = done.rig.left, &right = done.rig.right;
  const SE3& T = done.rig.T_right_left;
  std::string translation, rotation;
  for (int i = 0; i < 3; ++i) {
    const char* before = i == 0 ? "" : ", ";
    translation += before + web::plusMinus(1e3 * T.translation()(i), 1e3 * done.sigma.translation(i), 2);
    rotation += before + web::plusMinus(kDegreesPerRadian * T.euler()(i),
                                        kDegreesPerRadian * done.sigma.rotation(i), 4);
  }
  const Fields alone{{"left", done.left_alone_rms, "each camera calibrated alone: left [px]", 3},
                     {"right", done.right_alone_rms, "right [px]", 3}};
  return {
      {"board", boardFields(board)},
      {"rms_px", Fields{{"left", done.left_rms, "RMS: left [px]", 3},
                        {"right", done.right_rms, "right [px]", 3},
                        {"stereo", done.stereo_rms, "stereo [px]", 3}}},
      {"rms_alone_px", left.port ? Fields{} : alone},
      {"baseline_m", Fields{{"value", done.rig.baseline(), board ? "baseline [mm]" : "baseline as given [mm]",
                             web::plusMinus(1e3 * done.rig.baseline(), 1e3 * done.sigma.baseline, 2)},
                            {"sigma", done.sigma.baseline}}},
      {"T_right_left",
       Fields{{"translation_m", web::jsonOf(T.translation()), "right from left: x, y, z [mm]", translation},
              {"translation_sigma_m", web::jsonOf(done.sigma.translation)},
              {"euler_rad", web::jsonOf(T.euler()), "rotation about x, y, z (Euler) [deg]", rotation},
              {"rotation_sigma_rad", web::jsonOf(done.sigma.rotation)}}},
      {"left", web::jsonOf(cameraFields(left, done.sigma.left, right))},
      {"right", web::jsonOf(cameraFields(right, done.sigma.right, left))},
      {"left_port", web::jsonOf(portFields(left, done.sigma.left_port))},
      {"right_port", web::jsonOf(portFields(right, done.sigma.right_port))},
      {"coverage",
       Fields{{"left", coverage(done.views, &CalibratedView::left, left),
               "cells of an 8 x 6 grid over the image with points seen: left [%]", 0, 100},
              {"right", coverage(done.views, &CalibratedView::right, right), "right [%]", 0, 100}}},
      {"views", web::jsonOf(viewRecords(done))},
      {"dropped", web::jsonOf(droppedRecords(done))}};
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

void addParameters(web::ReportPage& report, const RigCalibration& done,
                   const std::optional<calibration::Chessboard>& board) {
  const auto camera = [](const std::string& name, const Camera& of, const calibration::CameraSigma& sigma,
                         const calibration::PortSigma& port_sigma, const Camera& other) {
    Fields out = web::named("camera", name + (of.port ? ", in air" : ""), cameraFields(of, sigma, other));
    out.emplace_back("port", portFields(of, port_sigma));
    return out;
  };
  const StereoRig& rig = done.rig;
  const auto& sigma = done.sigma;
  web::addTable(report, {camera("left", rig.left, sigma.left, sigma.left_port, rig.right),
                         camera("right", rig.right, sigma.right, sigma.right_port, rig.left)});
  report.table({}, web::rowsOf(calibrationFields(done, board)));
}

std::string summaryOf(const RigCalibration& done, bool board) {
  return std::to_string(done.views.size()) +
         (board ? " pairs of a chessboard. ± is one standard deviation from the scatter of the corners; it "
                  "knows nothing of a bent board or a wrong square."
                : " pairs of a scene that stood still. The baseline's error is every length's. ± is one "
                  "standard deviation from the scatter of what was seen again; it knows nothing of things "
                  "that moved.");
}

web::ReportPage calibrationPageOf(const RigCalibration& done,
                                  const std::optional<calibration::Chessboard>& board,
                                  const std::string& name) {
  web::ReportPage report("Stereo calibration " + name, summaryOf(done, board.has_value()));
  report.section("Parameters");
  addParameters(report, done, board);
  const double left = coverage(done.views, &CalibratedView::left, done.rig.left);
  const double right = coverage(done.views, &CalibratedView::right, done.rig.right);
  report.section("Coverage");
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
  web::addTable(report, viewRecords(done));
  report.section("Dropped");
  web::addTable(report, droppedRecords(done));
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
  writeFile(calib.string() + ".json", web::jsonOf(calibrationFields(done, board)).dump(2) + "\n");
}

}  // namespace fathom::topside

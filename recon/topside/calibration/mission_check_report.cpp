#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/calibration/mission_check.hpp"
#include "recon/topside/report/json_values.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;
using calibration::MountEstimate;

Json estimateJson(const MountEstimate& e) {
  return {{"known", e.known},
          {"off_deg", jsonOf(kDegreesPerRadian * e.rotation)},
          {"sigma_deg", jsonOf(kDegreesPerRadian * e.sigma)}};
}

Json missionJson(const MissionCheck& c, const MissionVerdict& verdict) {
  Json lines = Json::array(), cells = Json::array();
  for (const auto& l : verdict.lines) lines.push_back({{"verdict", nameOf(l.kind)}, {"text", l.text}});
  for (const auto& cell : c.epipolar.cells)
    cells.push_back({{"median_px", cell.median}, {"matches", cell.matches}});
  const auto& e = c.epipolar;
  const auto& r = c.range;
  const auto& m = c.mount;
  return {{"mission", c.mission},
          {"good", verdict.good},
          {"verdict", lines},
          {"pairs", c.pairs},
          {"unreadable", c.unreadable},
          {"matches", c.matches},
          {"epipolar",
           {{"median_px", e.median},
            {"sigma_px", e.sigma},
            {"worst_cell_px", e.worst_cell},
            {"columns", calibration::kEpipolarColumns},
            {"rows", calibration::kEpipolarRows},
            {"cells", cells},
            {"right_turned_deg", jsonOf(kDegreesPerRadian * e.rotation)},
            {"right_turned_sigma_deg", jsonOf(kDegreesPerRadian * e.rotation_sigma)},
            {"right_focal_longer", e.focal},
            {"right_focal_sigma", e.focal_sigma},
            {"sigma_after_px", e.sigma_after}}},
          {"range",
           {{"samples", r.samples},
            {"beams", c.beams},
            {"ratio", r.ratio},
            {"ratio_sigma", r.ratio_sigma},
            {"scatter", r.scatter},
            {"shortest_m", r.shortest},
            {"longest_m", r.longest},
            {"line_known", r.line_known},
            {"scale", r.scale},
            {"scale_sigma", r.scale_sigma},
            {"offset_m", r.offset},
            {"offset_sigma_m", r.offset_sigma}}},
          {"mount",
           {{"steps", m.steps},
            {"turned_rad", m.turned},
            {"travelled_m", m.travelled},
            {"camera_compass", estimateJson(m.compass)},
            {"camera_dvl", estimateJson(m.dvl)},
            {"both", estimateJson(m.both)},
            {"speed_ratio", m.speed_ratio},
            {"speed_ratio_sigma", m.speed_ratio_sigma},
            {"rotation_scatter_deg", kDegreesPerRadian * m.rotation_scatter},
            {"middle_scatter_m", m.middle_scatter}}}};
}

// Medians of the parts of the left image, blue where the match is above its line, red below.
void addCells(web::ReportPage& report, const MissionCheck& c) {
  constexpr double kFull = 1.0;  // of the colours [px]
  std::vector<web::Row> rows;
  web::Row head{"row \\ column"};
  for (int column = 1; column <= calibration::kEpipolarColumns; ++column) head.emplace_back(column);
  for (int row = 0; row < calibration::kEpipolarRows; ++row) {
    rows.push_back({row + 1});
    for (int column = 0; column < calibration::kEpipolarColumns; ++column) {
      const auto& cell =
          c.epipolar.cells[static_cast<std::size_t>(row * calibration::kEpipolarColumns + column)];
      if (cell.matches >= calibration::kEnoughInCell)
        rows.back().emplace_back(decimals(cell.median, 2), cell.median / kFull);
      else
        rows.back().emplace_back("few");
    }
  }
  report.text("Median of each part of the left image [px]; red: the match is below its epipolar line.");
  report.table(head, rows);
}

web::Plot epipolarHistogram(const MissionCheck& c) {
  constexpr double kLeast = 1.5;  // [px]
  constexpr int kBins = 61;
  const double reach = std::max(kLeast, std::abs(c.epipolar.median) + 6 * c.epipolar.sigma);
  return web::histogram(c.epipolar.errors, -reach, reach, kBins, "signed epipolar error [px]",
                        "median " + decimals(c.epipolar.median, 3) + " px, standard deviation " +
                            decimals(c.epipolar.sigma, 3) + " px");
}

void addRanges(web::ReportPage& report, const MissionCheck& c) {
  if (c.range_samples.empty()) return;
  using Kind = web::Series::Kind;
  const auto n = static_cast<double>(c.range_samples.size());
  double low = INFINITY, high = -INFINITY, sample = 0.5;
  web::Series ranges{.label = "samples", .kind = Kind::kDots},
      ratios{.label = "samples", .kind = Kind::kDots};
  for (const auto& s : c.range_samples) {
    low = std::min({low, s.dvl, s.stereo});
    high = std::max({high, s.dvl, s.stereo});
    ranges.at.emplace_back(s.dvl, s.stereo);
    ratios.at.emplace_back(sample++, s.stereo / s.dvl);
  }
  constexpr double kAllowed = 0.03;
  web::Series allowed{.label = "allowed", .kind = Kind::kAreas, .colour = "#8c9faa40"};
  allowed.rectangle({0, 1 - kAllowed}, {n, 1 + kAllowed});
  const std::string found = "stereo = " + decimals(c.range.ratio, 3) + " DVL";
  report.plot(
      {.title = "Range by stereo over range by DVL",
       .x = "range below the camera by DVL [m]",
       .y = "by stereo [m]",
       .series = {std::move(ranges),
                  {.label = "equal", .colour = web::kGrey, .at = {{low, low}, {high, high}}, .dashed = true},
                  {.label = found,
                   .colour = web::kRed,
                   .at = {{low, c.range.ratio * low}, {high, c.range.ratio * high}}}},
       .width = web::kHalfPage,
       .equal = true});
  report.plot(
      {.title = "Their ratio over the mission",
       .x = "sample, in order of time",
       .y = "stereo / DVL",
       .series = {std::move(allowed),
                  std::move(ratios),
                  {.label = found, .colour = web::kRed, .at = {{0, c.range.ratio}, {n, c.range.ratio}}}},
       .width = web::kHalfPage});
}

std::string angle(const MountEstimate& e, int axis) {
  if (!e.known) return "-";
  if (!std::isfinite(e.sigma(axis))) return "not observable";
  return web::plusMinus(kDegreesPerRadian * e.rotation(axis), kDegreesPerRadian * e.sigma(axis), 2);
}

void addMount(web::ReportPage& report, const MissionCheck& c) {
  const auto& m = c.mount;
  std::vector<web::Row> rows;
  for (const auto& [name, estimate] :
       {std::pair("camera against compass (rotations alone)", &m.compass),
        std::pair("camera against DVL (displacements alone)", &m.dvl), std::pair("both together", &m.both)})
    rows.push_back({name, angle(*estimate, 0), angle(*estimate, 1), angle(*estimate, 2)});
  report.table(
      {"off mission.toml by [deg]", "roll (about forward)", "pitch (about starboard)", "yaw (about down)"},
      rows);
  report.text(std::to_string(m.steps) + " steps between consecutive images, " + decimals(m.travelled, 1) +
              " m travelled, " + decimals(kDegreesPerRadian * m.turned, 0) +
              " deg turned in all; scatter of a step " + decimals(kDegreesPerRadian * m.rotation_scatter, 2) +
              " deg and " + decimals(1e3 * m.middle_scatter, 1) +
              " mm. Displacements leave the angle about the direction of travel open; rotations leave open "
              "the angle about their own axis. Where the camera sits is taken from mission.toml. ± is one "
              "standard deviation of the scatter; a constant error of the compass's tilt is in the value.");
  if (!m.both.known) return;
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = m.both.rotation;
  const SE3 now(SE3::exp(twist).rotation() * c.T_body_cam.rotation(), c.T_body_cam.translation());
  const auto shown = [](const Eigen::Vector3d& euler) {
    return "[" + decimals(euler.x(), 4) + ", " + decimals(euler.y(), 4) + ", " + decimals(euler.z(), 4) + "]";
  };
  report.text("euler_rad of extrinsics.T_body_cam: " + shown(c.T_body_cam.euler()) + " in mission.toml, " +
              shown(now.euler()) + " by this mission.");
}

web::ReportPage missionPageOf(const MissionCheck& c, const MissionVerdict& verdict) {
  web::ReportPage report("Check of a rig on a mission", c.mission + ": " + std::to_string(c.pairs) +
                                                            " pairs, " + std::to_string(c.matches) +
                                                            " matches made without the calibration's help.");
  for (const auto& l : verdict.lines) {
    const std::string line = std::string(nameOf(l.kind)) + ": " + l.text;
    l.kind == MissionVerdict::Line::Kind::kBad ? report.warning(line) : report.text(line);
  }
  const auto& e = c.epipolar;
  report.section("Epipolar error");
  addCells(report, c);
  report.plot(epipolarHistogram(c));
  const auto turned = [&](int axis) {
    return web::plusMinus(kDegreesPerRadian * e.rotation(axis), kDegreesPerRadian * e.rotation_sigma(axis),
                          4);
  };
  report.text("A right camera turned by pitch " + turned(0) + ", yaw " + turned(1) + ", roll " + turned(2) +
              " deg (about its x, y, z) explains the pattern best and leaves " + decimals(e.sigma_after, 3) +
              " px a match.");
  report.section("Stereo range against DVL");
  addRanges(report, c);
  report.text("Stereo's seafloor, gathered on a grid, where the DVL's beams fell, 30 deg off its axis (" +
              c.beams + "). " + std::to_string(c.range.samples) + " samples, scatter " +
              decimals(100 * c.range.scatter, 1) + " %.");
  report.section("How the camera is mounted");
  addMount(report, c);
  return report;
}

}  // namespace

void writeMissionCheck(const std::filesystem::path& folder, const MissionCheck& check,
                       const MissionVerdict& verdict) {
  missionPageOf(check, verdict).write(folder / "mission-check.html");
  writeFile(folder / "mission-check.json", missionJson(check, verdict).dump(2) + "\n");
}

}  // namespace fathom::topside

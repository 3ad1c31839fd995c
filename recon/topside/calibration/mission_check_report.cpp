#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "realtime/kernel/text.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/topside/calibration/mission_check.hpp"
#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/svg_plot.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;
using calibration::MountEstimate;

constexpr double kDegrees = 180.0 / std::numbers::pi;

Json triple(const Eigen::Vector3d& v, double factor = 1) {
  Json out = Json::array();
  for (int i = 0; i < 3; ++i) out.push_back(std::isfinite(v(i)) ? Json(factor * v(i)) : Json(nullptr));
  return out;
}

Json estimateJson(const MountEstimate& e) {
  return {{"known", e.known},
          {"off_deg", triple(e.rotation, kDegrees)},
          {"sigma_deg", triple(e.sigma, kDegrees)}};
}

Json toJson(const MissionCheck& c, const MissionVerdict& verdict) {
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
            {"right_turned_deg", triple(e.rotation, kDegrees)},
            {"right_turned_sigma_deg", triple(e.rotation_sigma, kDegrees)},
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
            {"rotation_scatter_deg", kDegrees * m.rotation_scatter},
            {"middle_scatter_m", m.middle_scatter}}}};
}

// Medians of the parts of the left image, blue where the match lies above its line, red below.
std::string cellPlot(const MissionCheck& c) {
  constexpr double kFull = 1.0;  // of the colours [px]
  const double width = c.left.width, height = c.left.height;
  SvgPlot plot({.width = 440,
                .height = 440 * height / width,
                .left = 0,
                .right = width,
                .bottom = height,
                .top = 0,
                .x_label = "u in the left image [px]",
                .y_label = "v [px]",
                .title = "median epipolar error of each part [px]"});
  const double w = width / calibration::kEpipolarColumns, h = height / calibration::kEpipolarRows;
  for (int row = 0; row < calibration::kEpipolarRows; ++row)
    for (int column = 0; column < calibration::kEpipolarColumns; ++column) {
      const auto& cell =
          c.epipolar.cells[static_cast<std::size_t>(row * calibration::kEpipolarColumns + column)];
      const bool enough = cell.matches >= calibration::kEnoughInCell;
      plot.rectangle({column * w, row * h}, {(column + 1) * w, (row + 1) * h},
                     enough ? divergingColour(cell.median / kFull) : "#eceff1",
                     std::to_string(cell.matches) + " matches");
      plot.text({(column + 0.5) * w, (row + 0.57) * h}, enough ? fixedDigits(cell.median, 2) : "few",
                enough && std::abs(cell.median) > 0.6 * kFull ? "#ffffff" : "#1b2733");
    }
  return plot.svg();
}

std::string epipolarHistogram(const MissionCheck& c) {
  constexpr double kLeast = 1.5;  // [px]
  constexpr int kBins = 61;
  const double reach = std::max(kLeast, std::abs(c.epipolar.median) + 6 * c.epipolar.sigma);
  return histogramSvg(c.epipolar.errors, -reach, reach, kBins, "signed epipolar error [px]",
                      "median " + fixedDigits(c.epipolar.median, 3) + " px, standard deviation " +
                          fixedDigits(c.epipolar.sigma, 3) + " px");
}

std::string rangePlot(const MissionCheck& c) {
  double low = INFINITY, high = -INFINITY;
  for (const auto& s : c.range_samples) {
    low = std::min({low, s.dvl, s.stereo});
    high = std::max({high, s.dvl, s.stereo});
  }
  if (!(high > low)) return "";
  const double margin = 0.05 * (high - low);
  low -= margin, high += margin;
  SvgPlot plot({.width = 340,
                .height = 340,
                .left = low,
                .right = high,
                .bottom = low,
                .top = high,
                .x_label = "range below the camera by DVL [m]",
                .y_label = "by stereo [m]",
                .title = "dashed: equal; red: stereo = " + fixedDigits(c.range.ratio, 3) + " DVL"});
  std::vector<Eigen::Vector2d> dots;
  for (const auto& s : c.range_samples) dots.emplace_back(s.dvl, s.stereo);
  plot.dots(dots, 2.0, "#1f77b4", 0.5);
  plot.line({{low, low}, {high, high}}, "#1b2733", 1.2, true);
  plot.line({{low, c.range.ratio * low}, {high, c.range.ratio * high}}, "#b3261e", 1.5);
  return plot.svg();
}

std::string ratioPlot(const MissionCheck& c) {
  if (c.range_samples.empty()) return "";
  const auto n = static_cast<double>(c.range_samples.size());
  double reach = 0.06;
  for (const auto& s : c.range_samples)
    reach = std::max(reach, std::min(0.5, 1.05 * std::abs(s.stereo / s.dvl - 1)));
  SvgPlot plot({.width = 440,
                .height = 340,
                .left = 0,
                .right = n,
                .bottom = 1 - reach,
                .top = 1 + reach,
                .x_label = "sample, in order of time",
                .y_label = "stereo / DVL",
                .title = "ratio over the mission; grey: allowed"});
  plot.rectangle({0, 0.97}, {n, 1.03}, "#e3e8ec");
  std::vector<Eigen::Vector2d> dots;
  for (std::size_t k = 0; k < c.range_samples.size(); ++k)
    dots.emplace_back(static_cast<double>(k) + 0.5, c.range_samples[k].stereo / c.range_samples[k].dvl);
  plot.dots(dots, 2.0, "#1f77b4", 0.6);
  plot.line({{0, c.range.ratio}, {n, c.range.ratio}}, "#b3261e", 1.5);
  return plot.svg();
}

std::string angle(const MountEstimate& e, int axis) {
  if (!e.known) return "-";
  if (!std::isfinite(e.sigma(axis))) return "not observable";
  return fixedDigits(kDegrees * e.rotation(axis), 2) + " &plusmn; " +
         fixedDigits(kDegrees * e.sigma(axis), 2);
}

std::string mountTable(const MissionCheck& c) {
  const auto& m = c.mount;
  std::string out =
      "<table><tr><th>off mission.toml by [deg]</th><th>roll (about forward)</th><th>pitch (about "
      "starboard)</th><th>yaw (about down)</th></tr>\n";
  const std::pair<const char*, const MountEstimate*> rows[] = {
      {"camera against compass (rotations alone)", &m.compass},
      {"camera against DVL (displacements alone)", &m.dvl},
      {"both together", &m.both}};
  for (const auto& [name, estimate] : rows) {
    out += std::string("<tr><td>") + name + "</td>";
    for (int i = 0; i < 3; ++i) out += "<td class=n>" + angle(*estimate, i) + "</td>";
    out += "</tr>\n";
  }
  out += "</table>\n<p>" + std::to_string(m.steps) + " steps between consecutive images, " +
         fixedDigits(m.travelled, 1) + " m travelled, " + fixedDigits(kDegrees * m.turned, 0) +
         " deg turned in all; scatter of a step " + fixedDigits(kDegrees * m.rotation_scatter, 2) +
         " deg and " + fixedDigits(1e3 * m.middle_scatter, 1) +
         " mm. Displacements leave the angle about the direction of travel open; rotations leave open the "
         "angle about their own axis. "
         "Where the camera sits is taken from mission.toml. &plusmn; is one standard deviation of the "
         "scatter; a constant error of the compass's tilt is in the value.</p>\n";
  if (m.both.known) {
    SE3 now = c.T_body_cam;
    Vector6d twist = Vector6d::Zero();
    twist.tail<3>() = m.both.rotation;
    now = SE3(SE3::exp(twist).rotation() * now.rotation(), now.translation());
    const Eigen::Vector3d was = c.T_body_cam.euler(), is = now.euler();
    out += "<p>euler_rad of extrinsics.T_body_cam: [" + fixedDigits(was.x(), 4) + ", " +
           fixedDigits(was.y(), 4) + ", " + fixedDigits(was.z(), 4) + "] in mission.toml, [" +
           fixedDigits(is.x(), 4) + ", " + fixedDigits(is.y(), 4) + ", " + fixedDigits(is.z(), 4) +
           "] by this mission.</p>\n";
  }
  return out;
}

std::string toHtml(const MissionCheck& c, const MissionVerdict& verdict) {
  std::string out = htmlHead("Check of a rig on a mission");
  out += "<p>" + markupText(c.mission) + ": " + std::to_string(c.pairs) + " pairs, " +
         std::to_string(c.matches) + " matches made without the calibration's help.</p>\n";
  for (const auto& l : verdict.lines)
    out += std::string("<p class=") +
           (l.kind == MissionVerdict::Line::Kind::kBad    ? "bad"
            : l.kind == MissionVerdict::Line::Kind::kGood ? "good"
                                                          : "open") +
           ">" + nameOf(l.kind) + ": " + markupText(l.text) + "</p>\n";
  const auto& e = c.epipolar;
  out += "<h2>Epipolar error</h2>\n<figure>" + cellPlot(c) + "</figure><figure>" + epipolarHistogram(c) +
         "</figure>\n<p>Positive: the match lies below its epipolar line in the right image. "
         "A right camera turned by pitch " +
         fixedDigits(kDegrees * e.rotation(0), 4) + " &plusmn; " +
         fixedDigits(kDegrees * e.rotation_sigma(0), 4) + ", yaw " +
         fixedDigits(kDegrees * e.rotation(1), 4) + " &plusmn; " +
         fixedDigits(kDegrees * e.rotation_sigma(1), 4) + ", roll " +
         fixedDigits(kDegrees * e.rotation(2), 4) + " &plusmn; " +
         fixedDigits(kDegrees * e.rotation_sigma(2), 4) +
         " deg (about its x, y, z) explains the pattern best and leaves " + fixedDigits(e.sigma_after, 3) +
         " px a match.</p>\n";
  out += "<h2>Stereo range against DVL</h2>\n";
  if (!c.range_samples.empty())
    out += "<figure>" + rangePlot(c) + "</figure><figure>" + ratioPlot(c) + "</figure>\n";
  out += "<p>Stereo's seafloor, gathered on a grid, where the DVL's beams fell, 30 deg off its axis (" +
         c.beams + "). " + std::to_string(c.range.samples) + " samples, scatter " +
         fixedDigits(100 * c.range.scatter, 1) + " %.</p>\n";
  out += "<h2>How the camera is mounted</h2>\n" + mountTable(c);
  return out + "</html>\n";
}

}  // namespace

void writeMissionCheck(const std::filesystem::path& folder, const MissionCheck& check,
                       const MissionVerdict& verdict) {
  AtomicFile json(folder / "mission-check.json"), html(folder / "mission-check.html");
  json.stream() << toJson(check, verdict).dump(2) << '\n';
  html.stream() << toHtml(check, verdict);
  json.commit();
  html.commit();
}

}  // namespace fathom::topside

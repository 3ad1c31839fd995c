#include <algorithm>
#include <cmath>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/calibration/mission_check.hpp"
#include "telemetry/web/report_fields.hpp"

namespace fathom::topside {
namespace {

using Kind = MissionVerdict::Line::Kind;

constexpr double kCertain = 3;          // standard deviations
constexpr double kMaxRange = 0.03;      // of the ranges; sound speed and tilt account for about 1 %
constexpr double kTooUncertain = 0.06;  // three standard deviations of the ranges' ratio
constexpr double kMaxSpeed = 0.02;      // of the distance travelled; a DVL is good to 0.5 %
constexpr double kMaxMount = 1.0 / kDegreesPerRadian;  // [rad]: moves the seafloor's map by 3.5 cm at 2 m
const char* const kTurnNames[3] = {"roll (about forward)", "pitch (about starboard)", "yaw (about down)"};

std::string pm(double value, double sigma, int digits) {
  return decimals(value, digits) + " +- " + decimals(sigma, digits);
}

// Bad only where it is certain; beyond what is allowed but not certainly so, it stays open.
Kind kindOf(double off, double sigma, double allowed) {
  if (std::abs(off) <= allowed) return Kind::kGood;
  return std::abs(off) > kCertain * sigma ? Kind::kBad : Kind::kOpen;
}

void judgeEpipolar(const MissionCheck& check, MissionVerdict& out) {
  const auto& e = check.epipolar;
  const bool bad = hasMoved(check.epipolar);
  std::string text = "epipolar error median " + decimals(e.median, 2) +
                     " px (allowed 0.5), worst part of the image " + decimals(e.worst_cell, 2) +
                     " px (allowed 0.75) at column " + std::to_string(e.worst_column + 1) + " of 8, row " +
                     std::to_string(e.worst_row + 1) + " of 6";
  if (bad) {
    text += ": the rig has moved; calibrate again. A right camera turned by";
    const char* const names[3] = {" pitch ", ", yaw ", ", roll "};
    for (int i = 0; i < 3; ++i)
      text += names[i] +
              pm(kDegreesPerRadian * e.change.rotation(i), kDegreesPerRadian * e.change_sigma.rotation(i), 4);
    text += " deg, with focal lengths " + pm(100 * e.change.focal, 100 * e.change_sigma.focal, 3) +
            " % longer and distortion (k1) " + pm(e.change.radial, e.change_sigma.radial, 4) +
            " more against the left one's, would explain it, but for " + decimals(e.sigma_after, 2) +
            " px a match";
  }
  out.lines.push_back({bad ? Kind::kBad : Kind::kGood, text});
}

void judgeRange(const MissionCheck& check, MissionVerdict& out) {
  const auto& r = check.range;
  if (r.ratio_sigma <= 0) {
    out.lines.push_back({Kind::kOpen, "stereo range against DVL altitude: " + std::to_string(r.samples) +
                                          " places seen by both, at least 8 are needed"});
    return;
  }
  Kind kind = kindOf(r.ratio - 1, r.ratio_sigma, kMaxRange);
  if (kind == Kind::kGood && kCertain * r.ratio_sigma > kTooUncertain) kind = Kind::kOpen;
  const bool bad = kind == Kind::kBad;
  std::string text = "stereo range is " + pm(r.ratio, r.ratio_sigma, 4) +
                     " of the DVL's (allowed 1 +- 0.03) over " + decimals(r.shortest, 2) + " to " +
                     decimals(r.longest, 2) + " m";
  if (r.line_known)
    text += "; scale " + pm(r.scale, r.scale_sigma, 4) + ", offset " + pm(r.offset, r.offset_sigma, 3) + " m";
  else
    text += "; scale and offset cannot be distinguished at one altitude";
  constexpr double kRefraction = 1.33, kNear = 0.06;  // index of sea water
  if (bad && (std::abs(r.ratio * kRefraction - 1) < kNear || std::abs(r.ratio / kRefraction - 1) < kNear))
    text += ": as of a flat port whose refraction one side leaves out (mission.toml says " + check.port +
            "); calibrate in water";
  else if (bad)
    text += ": focal length, baseline or toe-in are wrong; calibrate again";
  if (kind == Kind::kOpen) text += ": too uncertain to tell; fly longer, or over itself";
  out.lines.push_back({kind, text});
}

void judgeSpeed(const MissionCheck& check, MissionVerdict& out) {
  const auto& m = check.mount;
  if (!m.both.known || m.speed_ratio_sigma <= 0) return;
  const Kind kind = kindOf(m.speed_ratio - 1, m.speed_ratio_sigma, kMaxSpeed);
  std::string text =
      "distance seen is " + pm(m.speed_ratio, m.speed_ratio_sigma, 4) + " of the DVL's (allowed 1 +- 0.02)";
  if (hasMoved(check.epipolar)) {
    out.lines.push_back({Kind::kOpen, text + ": not reliable while the rig has moved"});
    return;
  }
  if (kind == Kind::kBad) text += ": the baseline's length or the speed of sound is wrong";
  out.lines.push_back({kind, text});
}

void judgeMount(const MissionCheck& check, MissionVerdict& out) {
  const auto& m = check.mount;
  if (!m.both.known) {
    out.lines.push_back({Kind::kOpen, "camera's mounting: " + std::to_string(m.steps) +
                                          " steps between images could be followed, at least 8 are needed"});
    return;
  }
  for (int i = 0; i < 3; ++i) {
    const double angle = m.both.rotation(i), sigma = m.both.sigma(i);
    if (!std::isfinite(sigma) || kCertain * sigma > 3 * kMaxMount) {
      out.lines.push_back(
          {Kind::kOpen,
           std::string("camera's ") + kTurnNames[i] + " is not observable from this mission: " +
               (i == 0 ? "turns, or rolling, would show it" : "a straight line at speed would show it")});
      continue;
    }
    const Kind kind = kindOf(angle, sigma, kMaxMount);
    std::string text = std::string("camera's ") + kTurnNames[i] + " against DVL and compass is " +
                       pm(kDegreesPerRadian * angle, kDegreesPerRadian * sigma, 2) +
                       " deg off mission.toml's (allowed 1)";
    if (kind == Kind::kBad) text += ": correct extrinsics.T_body_cam";
    if (kind == Kind::kOpen) text += ": too uncertain to tell; fly longer, with turns";
    out.lines.push_back({kind, text});
  }
}

}  // namespace

const char* nameOf(Kind kind) {
  return kind == Kind::kGood ? "good" : kind == Kind::kBad ? "BAD" : "open";
}

MissionVerdict judge(const MissionCheck& check) {
  MissionVerdict out;
  judgeEpipolar(check, out);
  judgeRange(check, out);
  judgeSpeed(check, out);
  judgeMount(check, out);
  out.good =
      std::none_of(out.lines.begin(), out.lines.end(), [](const auto& l) { return l.kind == Kind::kBad; });
  return out;
}

namespace {

using calibration::MountEstimate;
using web::Fields;

std::string angle(const MountEstimate& e, int axis) {
  if (!e.known) return "-";
  if (!std::isfinite(e.sigma(axis))) return "not observable";
  return web::plusMinus(kDegreesPerRadian * e.rotation(axis), kDegreesPerRadian * e.sigma(axis), 2);
}

Fields estimateFields(const MountEstimate& e) {
  return {{"known", e.known},
          {"off_deg", web::jsonOf(kDegreesPerRadian * e.rotation)},
          {"sigma_deg", web::jsonOf(kDegreesPerRadian * e.sigma)},
          web::onPage("roll (about forward)", angle(e, 0)),
          web::onPage("pitch (about starboard)", angle(e, 1)),
          web::onPage("yaw (about down)", angle(e, 2))};
}

Fields epipolarFields(const calibration::EpipolarCheck& e) {
  std::vector<Fields> cells;
  for (const auto& cell : e.cells) cells.push_back({{"median_px", cell.median}, {"matches", cell.matches}});
  const auto turned = [&](int axis) {
    return web::plusMinus(kDegreesPerRadian * e.change.rotation(axis),
                          kDegreesPerRadian * e.change_sigma.rotation(axis), 4);
  };
  return {{"median_px", e.median},
          {"sigma_px", e.sigma},
          {"worst_cell_px", e.worst_cell},
          {"columns", calibration::kEpipolarColumns},
          {"rows", calibration::kEpipolarRows},
          {"cells", web::jsonOf(cells)},
          {"right_turned_deg", web::jsonOf(kDegreesPerRadian * e.change.rotation),
           "right camera turned as explains the pattern best: pitch, yaw, roll (about its x, y, z) [deg]",
           turned(0) + ", " + turned(1) + ", " + turned(2)},
          {"right_turned_sigma_deg", web::jsonOf(kDegreesPerRadian * e.change_sigma.rotation)},
          {"right_focal_longer", e.change.focal},
          {"right_focal_sigma", e.change_sigma.focal},
          {"right_k1_more", e.change.radial},
          {"right_k1_sigma", e.change_sigma.radial},
          {"sigma_after_px", e.sigma_after, "which leaves of a match [px]", 3}};
}

Fields rangeFields(const MissionCheck& c) {
  const auto& r = c.range;
  return {{"samples", r.samples, "samples"},
          {"beams", c.beams, "beams"},
          {"ratio", r.ratio},
          {"ratio_sigma", r.ratio_sigma},
          {"scatter", r.scatter, "scatter [%]", 1, 100},
          {"shortest_m", r.shortest},
          {"longest_m", r.longest},
          {"line_known", r.line_known},
          {"scale", r.scale},
          {"scale_sigma", r.scale_sigma},
          {"offset_m", r.offset},
          {"offset_sigma_m", r.offset_sigma}};
}

Fields mountFields(const MissionCheck& c) {
  const auto& m = c.mount;
  return {{"steps", m.steps, "steps between consecutive images"},
          {"turned_rad", m.turned, "turned in all [deg]", 0, kDegreesPerRadian},
          {"travelled_m", m.travelled, "travelled [m]", 1},
          {"camera_compass", web::jsonOf(estimateFields(m.compass))},
          {"camera_dvl", web::jsonOf(estimateFields(m.dvl))},
          {"both", web::jsonOf(estimateFields(m.both))},
          {"speed_ratio", m.speed_ratio},
          {"speed_ratio_sigma", m.speed_ratio_sigma},
          {"rotation_scatter_deg", kDegreesPerRadian * m.rotation_scatter, "scatter of a step [deg]", 2},
          {"middle_scatter_m", m.middle_scatter, "scatter of a step [mm]", 1, 1e3}};
}

Fields missionFields(const MissionCheck& c, const MissionVerdict& verdict) {
  std::vector<Fields> lines;
  for (const auto& l : verdict.lines) lines.push_back({{"verdict", nameOf(l.kind)}, {"text", l.text}});
  return {{"mission", c.mission},
          {"good", verdict.good},
          {"verdict", web::jsonOf(lines)},
          {"pairs", c.pairs},
          {"unreadable", c.unreadable},
          {"matches", c.matches},
          {"epipolar", epipolarFields(c.epipolar)},
          {"range", rangeFields(c)},
          {"mount", mountFields(c)}};
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
  using enum web::Series::Kind;
  const auto n = static_cast<double>(c.range_samples.size());
  double low = INFINITY, high = -INFINITY, sample = 0.5;
  web::Series ranges{.label = "samples", .kind = kDots}, ratios{.label = "samples", .kind = kDots};
  for (const auto& s : c.range_samples) {
    low = std::min({low, s.dvl, s.stereo});
    high = std::max({high, s.dvl, s.stereo});
    ranges.at.emplace_back(s.dvl, s.stereo);
    ratios.at.emplace_back(sample++, s.stereo / s.dvl);
  }
  constexpr double kAllowed = 0.03;
  web::Series allowed{.label = "allowed", .kind = kAreas, .colour = "#8c9faa40"};
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

void addMount(web::ReportPage& report, const MissionCheck& c) {
  const auto& m = c.mount;
  const std::string off = "off mission.toml by [deg]";
  web::addTable(report,
                {web::named(off, "camera against compass (rotations alone)", estimateFields(m.compass)),
                 web::named(off, "camera against DVL (displacements alone)", estimateFields(m.dvl)),
                 web::named(off, "both together", estimateFields(m.both))});
  report.table({}, web::rowsOf(mountFields(c)));
  report.text(
      "Displacements leave the angle about the direction of travel open; rotations leave open the angle "
      "about "
      "their own axis. Where the camera sits is taken from mission.toml. ± is one standard deviation of the "
      "scatter; a constant error of the compass's tilt is in the value.");
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
  report.section("Epipolar error");
  addCells(report, c);
  report.plot(epipolarHistogram(c));
  report.table({}, web::rowsOf(epipolarFields(c.epipolar)));
  report.section("Stereo range against DVL");
  addRanges(report, c);
  report.text("Stereo's seafloor, gathered on a grid, where the DVL's beams fell, 30 deg off its axis:");
  report.table({}, web::rowsOf(rangeFields(c)));
  report.section("How the camera is mounted");
  addMount(report, c);
  return report;
}

}  // namespace

void writeMissionCheck(const std::filesystem::path& folder, const MissionCheck& check,
                       const MissionVerdict& verdict) {
  missionPageOf(check, verdict).write(folder / "mission-check.html");
  writeFile(folder / "mission-check.json", web::jsonOf(missionFields(check, verdict)).dump(2) + "\n");
}

}  // namespace fathom::topside

#include "recon/topside/report/compare_report.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "realtime/kernel/text.hpp"
#include "recon/compare/difference_picture.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/svg_plot.hpp"

namespace fathom::topside {
namespace {

using compare::Comparison, compare::DifferenceStatistics, compare::HeightMap;

using Json = nlohmann::ordered_json;

constexpr double kDegree = 180.0 / std::numbers::pi;

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json toJson(const DifferenceStatistics& s) {
  return {{"cells", s.cells},
          {"bias_m", s.bias},
          {"median_m", s.median},
          {"rms_m", s.rms},
          {"deviation_m", s.deviation},
          {"mad_m", s.mad},
          {"p1_m", s.p1},
          {"p5_m", s.p5},
          {"p25_m", s.p25},
          {"p75_m", s.p75},
          {"p95_m", s.p95},
          {"p99_m", s.p99},
          {"abs_p50_m", s.abs_p50},
          {"abs_p95_m", s.abs_p95}};
}

std::string statisticsRow(const std::string& name, const DifferenceStatistics& s,
                          const std::string& last = "") {
  std::string row = "<tr><td>" + markupText(name) + "</td><td class=n>" + std::to_string(s.cells) + "</td>";
  for (const double v : {s.bias, s.median, s.rms, s.mad, s.p5, s.p95, s.abs_p50, s.abs_p95})
    row += "<td class=n>" + fixedDigits(v, 4) + "</td>";
  if (!last.empty()) row += "<td class=n>" + last + "</td>";
  return row + "</tr>\n";
}

std::string statisticsHead(const std::string& first, const std::string& last = "") {
  return "<table><tr><th>" + first +
         "</th><th>cells</th><th>bias</th><th>median</th><th>RMS</th><th>1.4826 MAD</th><th>5 %</th><th>95 "
         "%</th>"
         "<th>50 % of |d|</th><th>95 % of |d|</th>" +
         (last.empty() ? "" : "<th>" + last + "</th>") + "</tr>\n";
}

// Ends of the difference's colours and of its histogram: most cells are inside.
double scaleOf(const Comparison& c) {
  return std::max(c.difference.after.abs_p95 * 1.5, 1e-4);
}

std::string offsetText(double value, double sigma) {
  return std::isfinite(sigma) ? fixedDigits(value, 4) + " \u00b1 " + fixedDigits(sigma, 4) + " m"
                              : fixedDigits(value, 4) + " m, not told by the terrain";
}

std::string page(const Comparison& c) {
  const compare::Registration& r = c.registration;
  std::string html = htmlHead("Survey against reference");
  html += "<table>";
  html += htmlRow("survey", c.options.survey.string() + " (" + c.survey_about + ")");
  html += htmlRow("reference", c.options.reference.string() + " (" + c.reference_about +
                                   (c.reference_turned ? ", depths turned into heights" : "") + ")");
  html += htmlRow("cell compared", fixedDigits(c.cell, 3) + " m (survey " + fixedDigits(c.survey_spacing, 3) +
                                       ", reference " + fixedDigits(c.reference_spacing, 3) + ")");
  html += htmlRow("area compared", fixedDigits(c.difference.overlap_m2, 1) + " of " +
                                       fixedDigits(c.difference.survey_m2, 1) + " m2");
  html += "</table>\n";
  for (const std::string& note : c.notes) html += "<p class=bad>" + markupText(note) + "</p>\n";
  html += "<h2>Offset that takes the survey onto the reference</h2><table>";
  html += htmlRow("east", offsetText(r.offset.shift.x(), r.sigma.x()));
  html += htmlRow("north", offsetText(r.offset.shift.y(), r.sigma.y()));
  html += htmlRow("up", offsetText(r.offset.shift.z(), r.sigma.z()));
  if (c.options.registration.tilt) {
    html += htmlRow("slope to the east", fixedDigits(1e3 * r.offset.tilt.x(), 3) + " \u00b1 " +
                                             fixedDigits(1e3 * r.tilt_sigma.x(), 3) + " mm/m");
    html += htmlRow("slope to the north", fixedDigits(1e3 * r.offset.tilt.y(), 3) + " \u00b1 " +
                                              fixedDigits(1e3 * r.tilt_sigma.y(), 3) + " mm/m");
  }
  if (r.directions_told == 1)
    html += htmlRow("not told along bearing", fixedDigits(r.open_bearing * kDegree, 0) + " deg");
  html += htmlRow("relief without its slope", fixedDigits(r.relief, 3) + " m");
  html += htmlRow("correlation of the terrains", fixedDigits(r.correlation, 3));
  html +=
      "</table>\n<p>One standard deviation each; what neighbouring cells err together is counted once. "
      "Heights of "
      "different vertical datums differ by that datum: it is part of the offset up.</p>\n";
  html += "<h2>Difference, survey less reference [m]</h2>\n" + statisticsHead("");
  html += statisticsRow("before registration", c.difference.before);
  html += statisticsRow("after", c.difference.after) + "</table>\n";
  html +=
      "<figure><img src=difference.png style='max-width:100%'><figcaption>Difference after registration; "
      "grey: one of "
      "the two is unknown. <a href=difference.tif>difference.tif</a></figcaption></figure>\n";
  std::vector<double> values;
  for (const float d : c.difference.map.up)
    if (std::isfinite(d)) values.push_back(static_cast<double>(d));
  html += "<figure>" +
          histogramSvg(values, -scaleOf(c), scaleOf(c), 60, "difference [m]", "cells by difference") +
          "</figure>\n";
  html += "<h2>By slope of the reference</h2>\n" + statisticsHead("slope [deg]");
  for (const compare::DifferenceClass& k : c.difference.by_slope)
    html += statisticsRow(fixedDigits(k.from, 0) + " to " + fixedDigits(k.to, 0), k.statistics);
  html += "</table>\n";
  if (!c.difference.by_sigma.empty()) {
    html += "<h2>By the survey's own uncertainty</h2>\n" + statisticsHead("sigma [m]", "RMS of d / sigma");
    for (const compare::DifferenceClass& k : c.difference.by_sigma)
      html += statisticsRow(fixedDigits(k.from, 4) + " to " + fixedDigits(k.to, 4), k.statistics,
                            fixedDigits(k.rms_over_sigma, 2));
    html += "</table>\n";
  }
  html +=
      "<h2>Heights [m]</h2>\n<figure><img src=survey.png style='max-width:100%'><figcaption>The survey, "
      "where it says that it "
      "lies.</figcaption></figure>\n<figure><img src=reference.png style='max-width:100%'><figcaption>The "
      "reference in its "
      "cells.</figcaption></figure>\n";
  return html;
}

void write(const std::filesystem::path& path, const std::string& text) {
  AtomicFile file(path);
  file.stream() << text;
  file.commit();
}

}  // namespace

std::string comparisonJson(const Comparison& c) {
  const compare::Registration& r = c.registration;
  Json json;
  json["survey"] = c.options.survey.string();
  json["reference"] = c.options.reference.string();
  json["reference_held_depths"] = c.reference_turned;
  json["frame"] = c.plane.wkt;
  json["cell_m"] = c.cell;
  json["survey_spacing_m"] = c.survey_spacing;
  json["reference_spacing_m"] = c.reference_spacing;
  json["survey_m2"] = c.difference.survey_m2;
  json["compared_m2"] = c.difference.overlap_m2;
  Json& offset = json["offset"];
  offset["east_m"] = r.offset.shift.x();
  offset["north_m"] = r.offset.shift.y();
  offset["up_m"] = r.offset.shift.z();
  offset["east_sigma_m"] = number(r.sigma.x());
  offset["north_sigma_m"] = number(r.sigma.y());
  offset["up_sigma_m"] = number(r.sigma.z());
  offset["horizontal_directions_told"] = r.directions_told;
  offset["open_bearing_deg"] = r.directions_told == 1 ? Json(r.open_bearing * kDegree) : Json(nullptr);
  offset["at_limit"] = r.at_limit;
  offset["tilt_east"] = r.offset.tilt.x();
  offset["tilt_north"] = r.offset.tilt.y();
  offset["tilt_east_sigma"] = c.options.registration.tilt ? number(r.tilt_sigma.x()) : Json(nullptr);
  offset["tilt_north_sigma"] = c.options.registration.tilt ? number(r.tilt_sigma.y()) : Json(nullptr);
  offset["centre_east_m"] = r.offset.centre.x();
  offset["centre_north_m"] = r.offset.centre.y();
  offset["correlation"] = r.correlation;
  offset["relief_m"] = r.relief;
  json["before"] = toJson(c.difference.before);
  json["after"] = toJson(c.difference.after);
  json["by_slope"] = Json::array();
  for (const compare::DifferenceClass& k : c.difference.by_slope) {
    Json row = toJson(k.statistics);
    row["from_deg"] = k.from;
    row["to_deg"] = k.to;
    json["by_slope"].push_back(row);
  }
  json["by_uncertainty"] = Json::array();
  for (const compare::DifferenceClass& k : c.difference.by_sigma) {
    Json row = toJson(k.statistics);
    row["from_m"] = k.from;
    row["to_m"] = k.to;
    row["rms_over_sigma"] = k.rms_over_sigma;
    json["by_uncertainty"].push_back(row);
  }
  json["notes"] = c.notes;
  return json.dump(2) + "\n";
}

std::string comparisonText(const Comparison& c) {
  const compare::Registration& r = c.registration;
  const DifferenceStatistics& s = c.difference.after;
  std::string text;
  for (const std::string& note : c.notes) text += "note: " + note + "\n";
  text += "offset onto the reference: east " + offsetText(r.offset.shift.x(), r.sigma.x()) + ", north " +
          offsetText(r.offset.shift.y(), r.sigma.y()) + ", up " +
          offsetText(r.offset.shift.z(), r.sigma.z()) + "\n";
  if (c.options.registration.tilt)
    text += "slope: east " + fixedDigits(1e3 * r.offset.tilt.x(), 3) + ", north " +
            fixedDigits(1e3 * r.offset.tilt.y(), 3) + " mm/m\n";
  text += "difference over " + fixedDigits(c.difference.overlap_m2, 1) + " m2 in cells of " +
          fixedDigits(c.cell, 3) + " m: bias " + fixedDigits(s.bias, 4) + ", RMS " + fixedDigits(s.rms, 4) +
          " (before " + fixedDigits(c.difference.before.rms, 4) + "), 1.4826 MAD " + fixedDigits(s.mad, 4) +
          ", 95 % below " + fixedDigits(s.abs_p95, 4) + " m\n";
  return text;
}

void writeComparison(const Comparison& c, const std::filesystem::path& folder) {
  writeGeoTiff(c.difference.map, c.plane, folder / "difference.tif");
  drawDifference(c.difference.map, scaleOf(c), folder / "difference.png");
  std::vector<double> heights;
  for (const float h : c.reference.up)
    if (std::isfinite(h)) heights.push_back(static_cast<double>(h));
  std::sort(heights.begin(), heights.end());
  const auto at = [&](double part) {
    return heights[static_cast<std::size_t>(part * static_cast<double>(heights.size() - 1))];
  };
  drawHeights(c.reference, at(0.01), at(0.99), folder / "reference.png");
  drawHeights(c.survey, at(0.01) - c.registration.offset.shift.z(),
              at(0.99) - c.registration.offset.shift.z(), folder / "survey.png");
  write(folder / "compare.json", comparisonJson(c));
  write(folder / "compare.html", page(c));
}

}  // namespace fathom::topside

#include "recon/topside/report/compare_report.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/compare/difference.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using compare::Comparison, compare::DifferenceStatistics, compare::HeightMap;

using Json = nlohmann::ordered_json;

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

web::Row statisticsHead(const std::string& first) {
  return {first, "cells", "bias", "median", "RMS", "1.4826 MAD", "5 %", "95 %", "50 % of |d|", "95 % of |d|"};
}

web::Row statisticsRow(const std::string& name, const DifferenceStatistics& s) {
  web::Row row{name, s.cells};
  for (const double v : {s.bias, s.median, s.rms, s.mad, s.p5, s.p95, s.abs_p50, s.abs_p95})
    row.emplace_back(decimals(v, 4));
  return row;
}

// Ends of the difference's colours and of its histogram: most cells are inside.
double scaleOf(const Comparison& c) {
  return std::max(c.difference.after.abs_p95 * 1.5, 1e-4);
}

std::string offsetText(double value, double sigma) {
  return std::isfinite(sigma) ? web::plusMinus(value, sigma, 4) + " m"
                              : decimals(value, 4) + " m, not resolved by the terrain";
}

std::vector<web::Row> offsetRows(const Comparison& c) {
  const compare::SurfaceRegistration& r = c.registration;
  std::vector<web::Row> rows{{"east", offsetText(r.offset.shift.x(), r.sigma.x())},
                             {"north", offsetText(r.offset.shift.y(), r.sigma.y())},
                             {"up", offsetText(r.offset.shift.z(), r.sigma.z())}};
  const auto slope = [&](const char* name, double value, double sigma) {
    rows.push_back({name, web::plusMinus(1e3 * value, 1e3 * sigma, 3) + " mm/m"});
  };
  if (c.options.registration.tilt) {
    slope("slope to the east", r.offset.tilt.x(), r.tilt_sigma.x());
    slope("slope to the north", r.offset.tilt.y(), r.tilt_sigma.y());
  }
  if (r.directions_resolved == 1)
    rows.push_back({"not resolved along bearing", decimals(r.open_bearing * kDegreesPerRadian, 0) + " deg"});
  rows.push_back({"relief without its slope", decimals(r.relief, 3) + " m"});
  rows.push_back({"correlation of the terrains", decimals(r.correlation, 3)});
  return rows;
}

web::ReportPage pageOf(const Comparison& c, const std::filesystem::path& folder) {
  web::ReportPage report(
      "Survey against reference",
      "Difference: survey less reference, in metres. difference.tif beside this page has it.");
  report.table({}, {{"survey", c.options.survey.string() + " (" + c.survey_about + ")"},
                    {"reference", c.options.reference.string() + " (" + c.reference_about +
                                      (c.reference_turned ? ", depths turned into heights" : "") + ")"},
                    {"cell compared", decimals(c.cell, 3) + " m (survey " + decimals(c.survey_spacing, 3) +
                                          ", reference " + decimals(c.reference_spacing, 3) + ")"},
                    {"area compared", decimals(c.difference.overlap_m2, 1) + " of " +
                                          decimals(c.difference.survey_m2, 1) + " m²"}});
  for (const std::string& note : c.notes) report.warning(note);
  report.section("Offset that takes the survey onto the reference");
  report.table({}, offsetRows(c));
  report.text(
      "One standard deviation each; what neighbouring cells err together is counted once. Heights of "
      "different vertical datums differ by that datum: it is part of the offset up.");
  report.section("Difference");
  report.table(statisticsHead(""), {statisticsRow("before registration", c.difference.before),
                                    statisticsRow("after", c.difference.after)});
  report.pictureFile(folder / "difference.png",
                     "Difference after registration; grey: one of the two is unknown.");
  std::vector<double> values;
  for (const float d : c.difference.map.up)
    if (std::isfinite(d)) values.push_back(static_cast<double>(d));
  report.plot(web::histogram(values, -scaleOf(c), scaleOf(c), 60, "difference [m]", "cells by difference"));
  report.section("By slope of the reference");
  std::vector<web::Row> rows;
  for (const compare::DifferenceClass& k : c.difference.by_slope)
    rows.push_back(statisticsRow(decimals(k.from, 0) + " to " + decimals(k.to, 0), k.statistics));
  report.table(statisticsHead("slope [deg]"), rows);
  report.section("By the survey's own uncertainty");
  rows.clear();
  for (const compare::DifferenceClass& k : c.difference.by_sigma) {
    rows.push_back(statisticsRow(decimals(k.from, 4) + " to " + decimals(k.to, 4), k.statistics));
    rows.back().emplace_back(decimals(k.rms_over_sigma, 2));
  }
  web::Row head = statisticsHead("sigma [m]");
  head.emplace_back("RMS of d / sigma");
  if (!rows.empty()) report.table(head, rows);
  report.section("Heights");
  report.pictureFile(folder / "survey.png", "The survey at its own place.");
  report.pictureFile(folder / "reference.png", "The reference in its cells.");
  return report;
}

}  // namespace

std::string comparisonJson(const Comparison& c) {
  const compare::SurfaceRegistration& r = c.registration;
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
  offset["horizontal_directions_told"] = r.directions_resolved;
  offset["open_bearing_deg"] =
      r.directions_resolved == 1 ? Json(r.open_bearing * kDegreesPerRadian) : Json(nullptr);
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
  const compare::SurfaceRegistration& r = c.registration;
  const DifferenceStatistics& s = c.difference.after;
  std::string text;
  for (const std::string& note : c.notes) text += "note: " + note + "\n";
  text += "offset onto the reference: east " + offsetText(r.offset.shift.x(), r.sigma.x()) + ", north " +
          offsetText(r.offset.shift.y(), r.sigma.y()) + ", up " +
          offsetText(r.offset.shift.z(), r.sigma.z()) + "\n";
  if (c.options.registration.tilt)
    text += "slope: east " + decimals(1e3 * r.offset.tilt.x(), 3) + ", north " +
            decimals(1e3 * r.offset.tilt.y(), 3) + " mm/m\n";
  text += "difference over " + decimals(c.difference.overlap_m2, 1) + " m2 in cells of " +
          decimals(c.cell, 3) + " m: bias " + decimals(s.bias, 4) + ", RMS " + decimals(s.rms, 4) +
          " (before " + decimals(c.difference.before.rms, 4) + "), 1.4826 MAD " + decimals(s.mad, 4) +
          ", 95 % below " + decimals(s.abs_p95, 4) + " m\n";
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
  writeFile(folder / "compare.json", comparisonJson(c));
  pageOf(c, folder).write(folder / "compare.html");
}

}  // namespace fathom::topside

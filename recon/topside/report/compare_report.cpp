#include "recon/topside/report/compare_report.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/compare/compare.hpp"
#include "telemetry/web/report_fields.hpp"

namespace fathom::topside {
namespace {

using compare::Comparison, compare::DifferenceClass, compare::DifferenceStatistics;
using web::Fields;

Fields statisticsFields(const DifferenceStatistics& s) {
  return {{"cells", s.cells, "cells"},
          {"bias_m", s.bias, "bias [m]", 4},
          {"median_m", s.median, "median [m]", 4},
          {"rms_m", s.rms, "RMS [m]", 4},
          {"deviation_m", s.deviation},
          {"mad_m", s.mad, "1.4826 MAD [m]", 4},
          {"p1_m", s.p1},
          {"p5_m", s.p5, "5 % [m]", 4},
          {"p25_m", s.p25},
          {"p75_m", s.p75},
          {"p95_m", s.p95, "95 % [m]", 4},
          {"p99_m", s.p99},
          {"abs_p50_m", s.abs_p50, "50 % of |d| [m]", 4},
          {"abs_p95_m", s.abs_p95, "95 % of |d| [m]", 4}};
}

// Classes by slope in degrees.
std::vector<Fields> slopeRecords(const Comparison& c) {
  std::vector<Fields> out;
  for (const DifferenceClass& k : c.difference.by_slope) {
    Fields& row = out.emplace_back(web::named("slope [deg]", decimals(k.from, 0) + " to " + decimals(k.to, 0),
                                              statisticsFields(k.statistics)));
    row.emplace_back("from_deg", k.from);
    row.emplace_back("to_deg", k.to);
  }
  return out;
}

std::vector<Fields> uncertaintyRecords(const Comparison& c) {
  std::vector<Fields> out;
  for (const DifferenceClass& k : c.difference.by_sigma) {
    Fields& row = out.emplace_back(web::named("sigma [m]", decimals(k.from, 4) + " to " + decimals(k.to, 4),
                                              statisticsFields(k.statistics)));
    row.emplace_back("from_m", k.from);
    row.emplace_back("to_m", k.to);
    row.emplace_back("rms_over_sigma", k.rms_over_sigma, "RMS of d / sigma", 2);
  }
  return out;
}

// Ends of the difference's colours and of its histogram: most cells are inside.
double scaleOf(const Comparison& c) {
  return std::max(c.difference.after.abs_p95 * 1.5, 1e-4);
}

std::string offsetText(double value, double sigma) {
  return std::isfinite(sigma) ? web::plusMinus(value, sigma, 4) + " m"
                              : decimals(value, 4) + " m, not resolved by the terrain";
}

Fields offsetFields(const Comparison& c) {
  const compare::SurfaceRegistration& r = c.registration;
  const bool tilted = c.options.registration.tilt, open = r.directions_resolved == 1;
  const auto slope = [&](const char* key, const char* title, double value, double sigma) {
    return tilted ? web::ReportField(key, value, title, web::plusMinus(1e3 * value, 1e3 * sigma, 3) + " mm/m")
                  : web::ReportField(key, value);
  };
  return {{"east_m", r.offset.shift.x(), "east", offsetText(r.offset.shift.x(), r.sigma.x())},
          {"north_m", r.offset.shift.y(), "north", offsetText(r.offset.shift.y(), r.sigma.y())},
          {"up_m", r.offset.shift.z(), "up", offsetText(r.offset.shift.z(), r.sigma.z())},
          {"east_sigma_m", r.sigma.x()},
          {"north_sigma_m", r.sigma.y()},
          {"up_sigma_m", r.sigma.z()},
          {"horizontal_directions_told", r.directions_resolved},
          open ? web::ReportField("open_bearing_deg", r.open_bearing * kDegreesPerRadian,
                                  "not resolved along bearing [deg]", 0)
               : web::ReportField("open_bearing_deg", nullptr),
          {"at_limit", r.at_limit},
          slope("tilt_east", "slope to the east", r.offset.tilt.x(), r.tilt_sigma.x()),
          slope("tilt_north", "slope to the north", r.offset.tilt.y(), r.tilt_sigma.y()),
          {"tilt_east_sigma", tilted ? r.tilt_sigma.x() : NAN},
          {"tilt_north_sigma", tilted ? r.tilt_sigma.y() : NAN},
          {"centre_east_m", r.offset.centre.x()},
          {"centre_north_m", r.offset.centre.y()},
          {"correlation", r.correlation, "correlation of the terrains", 3},
          {"relief_m", r.relief, "relief without its slope [m]", 3}};
}

Fields surveyFields(const Comparison& c) {
  return {{"survey", c.options.survey.string(), "survey",
           c.options.survey.string() + " (" + c.survey_about + ")"},
          {"reference", c.options.reference.string(), "reference",
           c.options.reference.string() + " (" + c.reference_about +
               (c.reference_turned ? ", depths turned into heights" : "") + ")"},
          {"reference_held_depths", c.reference_turned},
          {"frame", c.plane.wkt},
          {"cell_m", c.cell, "cell compared [m]", 3},
          {"survey_spacing_m", c.survey_spacing, "of the survey [m]", 3},
          {"reference_spacing_m", c.reference_spacing, "of the reference [m]", 3},
          {"survey_m2", c.difference.survey_m2, "area of the survey [m²]", 1},
          {"compared_m2", c.difference.overlap_m2, "of it compared [m²]", 1}};
}

web::ReportPage pageOf(const Comparison& c, const std::filesystem::path& folder) {
  web::ReportPage report(
      "Survey against reference",
      "Difference: survey less reference, in metres. difference.tif beside this page has it.");
  report.table({}, web::rowsOf(surveyFields(c)));
  for (const std::string& note : c.notes) report.warning(note);
  report.section("Offset that takes the survey onto the reference");
  report.table({}, web::rowsOf(offsetFields(c)));
  report.text(
      "One standard deviation each; what neighbouring cells err together is counted once. Heights of "
      "different vertical datums differ by that datum: it is part of the offset up.");
  report.section("Difference");
  web::addTable(report, {web::named("registration", "before", statisticsFields(c.difference.before)),
                         web::named("registration", "after", statisticsFields(c.difference.after))});
  report.pictureFile(folder / "difference.png",
                     "Difference after registration; grey: one of the two is unknown.");
  std::vector<double> values;
  for (const float d : c.difference.map.up)
    if (std::isfinite(d)) values.push_back(static_cast<double>(d));
  report.plot(web::histogram(values, -scaleOf(c), scaleOf(c), 60, "difference [m]", "cells by difference"));
  report.section("By slope of the reference");
  web::addTable(report, slopeRecords(c));
  report.section("By the survey's own uncertainty");
  web::addTable(report, uncertaintyRecords(c));
  report.section("Heights");
  report.pictureFile(folder / "survey.png", "The survey at its own place.");
  report.pictureFile(folder / "reference.png", "The reference in its cells.");
  return report;
}

}  // namespace

std::string comparisonJson(const Comparison& c) {
  Fields fields = surveyFields(c);
  fields.emplace_back("offset", offsetFields(c));
  fields.emplace_back("before", statisticsFields(c.difference.before));
  fields.emplace_back("after", statisticsFields(c.difference.after));
  fields.emplace_back("by_slope", web::jsonOf(slopeRecords(c)));
  fields.emplace_back("by_uncertainty", web::jsonOf(uncertaintyRecords(c)));
  fields.emplace_back("notes", c.notes);
  return web::jsonOf(fields).dump(2) + "\n";
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

#include "recon/topside/report/slam_page.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/report/control_report.hpp"
#include "recon/topside/report/pose_output.hpp"
#include "recon/topside/report/slam_json.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using web::Plot, web::Row, web::Series;

constexpr double kLow2 = 1.24, kHigh2 = 14.45;  // chi-square, 6 degrees of freedom: 2.5 % and 97.5 %

double rmsOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return values.empty() ? 0 : std::sqrt(sum / static_cast<double>(values.size()));
}

Plot tracksPlot(const Navigation& navigation, const SlamResult& slam) {
  Series before{.label = "dead reckoning", .colour = web::kGrey, .dashed = true};
  Series after{.label = "localised", .colour = web::kBlue, .size = 1.5};
  Series kept{.label = "closures", .colour = web::kGreen, .size = 0.5};
  Series removed{.label = "closures taken out again", .colour = web::kRed};
  for (const auto& [poses, line] : {std::pair(&navigation.poses, &before), std::pair(&slam.poses, &after)})
    for (const NavigatedPose& pose : *poses)
      if (pose.T_nav_body) line->at.push_back(eastNorth(*pose.T_nav_body));
  for (const slam::NavigationLink& c : slam.closures) {
    const auto &a = slam.poses[c.a].T_nav_body, &b = slam.poses[c.b].T_nav_body;
    if (!a || !b) continue;
    Series& line = c.kept ? kept : removed;
    line.at.insert(line.at.end(), {eastNorth(*a), eastNorth(*b)});
    line.lift();
  }
  return {.title = "Tracks from above, north up",
          .x = "east [m]",
          .y = "north [m]",
          .series = {std::move(before), std::move(kept), std::move(removed), std::move(after)},
          .equal = true};
}

void addClosureErrors(web::ReportPage& report, const std::vector<double>& reckoned,
                      const std::vector<double>& solved) {
  if (reckoned.empty()) return;
  constexpr int kBins = 40;
  const double most = std::max(*std::max_element(reckoned.begin(), reckoned.end()), 0.01);
  report.plot(web::histogram(reckoned, 0, most, kBins, "m",
                             "dead reckoning: rms " + decimals(rmsOf(reckoned), 3) + " m"));
  report.plot(
      web::histogram(solved, 0, most, kBins, "m", "localised: rms " + decimals(rmsOf(solved), 4) + " m"));
}

std::vector<Row> slamCountRows(const SlamResult& slam, std::size_t kept) {
  std::vector<Row> rows = {{"pairs with features", slam.frames},
                           {"visual odometry links", slam.odometry.size()},
                           {"closures tried", slam.tried.size()},
                           {"closures accepted", slam.closures.size()},
                           {"closures kept", kept}};
  for (std::size_t k = 1; k < slam.refused.size(); ++k)
    rows.push_back(
        {"refused: " + std::string(closure::nameOf(static_cast<closure::Refusal>(k))), slam.refused[k]});
  rows.push_back({"closures left out: nothing confirmed them", slam.unconfirmed});
  rows.push_back({"fixes kept", slam.fixes_kept});
  rows.push_back({"fixes taken out", slam.fixes_removed});
  rows.push_back({"steps where visual odometry contradicts dead reckoning", slam.sensors.steps_contradicted});
  rows.push_back({"steps without bottom track", slam.sensors.dvl_absent});
  rows.push_back({"leaps of the compass", slam.sensors.compass_jumps});
  rows.push_back({"ground seen before, expected [m of track]", decimals(slam.crossings_expected, 1)});
  rows.push_back({"of it without a closure", decimals(slam.crossings_unverified, 1)});
  for (const auto& [name, value] : bundleRows(slam)) rows.push_back({name, value});
  for (const auto& [name, value] : calibrationRows(slam)) rows.push_back({name, value});
  return rows;
}

using Value = std::function<double(const Consistency::Moment&)>;

Plot errorPlot(const Consistency& c, const Value& error, const Value& sigma, const std::string& unit) {
  Series line{.label = "error"},
      upper{.label = "two standard deviations as claimed", .colour = web::kGrey, .dashed = true},
      lower{.colour = web::kGrey, .dashed = true};
  for (const Consistency::Moment& m : c.moments) {
    line.at.emplace_back(m.time_s, error(m));
    upper.at.emplace_back(m.time_s, 2 * sigma(m));
    lower.at.emplace_back(m.time_s, -2 * sigma(m));
  }
  return {.title = "Error " + unit,
          .x = "time [s]",
          .y = unit,
          .series = {std::move(upper), std::move(lower), std::move(line)},
          .width = web::kHalfPage};
}

Plot squaredPlot(const Consistency& c, const Value& value, const std::string& of) {
  Series dots{.label = "squared error over covariance", .kind = Series::Kind::kDots, .size = 1.2};
  for (const Consistency::Moment& m : c.moments) dots.at.emplace_back(m.time_s, value(m));
  Series bounds{.label = "95 % of chi-square, 6 degrees of freedom", .colour = web::kRed, .dashed = true};
  for (const double bound : {kLow2, kHigh2}) {
    bounds.at.insert(bounds.at.end(), {{0, bound}, {c.moments.back().time_s, bound}});
    bounds.lift();
  }
  return {.title = "Squared error over covariance, " + of,
          .x = "time [s]",
          .y = "6 expected",
          .series = {std::move(dots), std::move(bounds)},
          .width = web::kHalfPage};
}

void addTruth(web::ReportPage& report, const Consistency& c) {
  if (c.moments.empty()) return;
  constexpr const char* kPlace[] = {"north [m]", "east [m]", "down [m]"};
  constexpr const char* kTurn[] = {"tilt about north [deg]", "tilt about east [deg]", "heading [deg]"};
  for (int i = 0; i < 3; ++i) {
    report.plot(errorPlot(
        c, [i](const auto& m) { return m.position(i); }, [i](const auto& m) { return m.sigma_position(i); },
        kPlace[i]));
    report.plot(errorPlot(
        c, [i](const auto& m) { return m.turn(i) / kRadiansPerDegree; },
        [i](const auto& m) { return m.sigma_turn(i) / kRadiansPerDegree; }, kTurn[i]));
  }
  report.plot(squaredPlot(
      c, [](const auto& m) { return m.squared; }, "in nav"));
  report.plot(squaredPlot(
      c, [](const auto& m) { return m.since_first; }, "from the first pair"));
  report.table({}, {{"mean squared error over covariance (6 expected), in nav", decimals(c.mean_squared, 2)},
                    {"from the first pair", decimals(c.mean_since_first, 2)},
                    {"false closures", c.false_closures},
                    {"pairs that overlap by more than 30 %: there, tried, accepted",
                     std::to_string(c.overlapping) + ", " + std::to_string(c.overlapping_tried) + ", " +
                         std::to_string(c.overlapping_accepted)}});
}

}  // namespace

void writeSlamPage(const std::filesystem::path& file, const SlamResult& slam, const Navigation& navigation,
                   const SE3& T_body_cam, bool features_only, const Consistency& truth) {
  const std::vector<double> before = closureErrors(slam.closures, navigation.poses, T_body_cam);
  const std::vector<double> after = closureErrors(slam.closures, slam.poses, T_body_cam);
  web::ReportPage report("Localisation",
                         features_only ? "A mission without images: features that were matched before." : "");
  for (const std::string& warning : slamWarnings(slam)) report.warning(warning);
  report.section("Tracks");
  report.plot(tracksPlot(navigation, slam));
  report.section("Misregistration where the vehicle came back");
  addClosureErrors(report, before, after);
  report.section("Counts");
  report.table({}, slamCountRows(slam, after.size()));
  addControl(report, slam.control);
  report.section("Against the truth");
  addTruth(report, truth);
  report.section("Seconds");
  std::vector<Row> stages;
  for (const auto& [stage, seconds] : slam.seconds) stages.push_back({stage, decimals(seconds, 2)});
  report.table({}, stages);
  report.write(file);
}

}  // namespace fathom::topside

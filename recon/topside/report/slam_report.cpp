#include "recon/topside/report/slam_report.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/report/control_report.hpp"
#include "recon/topside/report/pose_output.hpp"

namespace fathom::topside {
namespace {

using web::ReportField, web::Fields;
using Json = nlohmann::ordered_json;

constexpr const char* kAngles[] = {"roll", "pitch", "yaw"};

// Estimate less truth and estimated standard deviation in nav axes (north, east, down); rotation about these.
Fields momentFields(const Consistency::Moment& m) {
  return {{"time_s", m.time_s},
          {"error_m", web::jsonOf(m.position)},
          {"sigma_m", web::jsonOf(m.sigma_position)},
          {"turn_error_rad", web::jsonOf(m.turn)},
          {"turn_sigma_rad", web::jsonOf(m.sigma_turn)},
          {"squared_error_over_covariance", m.squared},
          {"squared_error_over_covariance_since_first", m.since_first}};
}

std::string withSigma(double value, double sigma, int digits) {
  return decimals(value, digits) + " (standard deviation " + decimals(sigma, digits) + ")";
}

// SlamResult::mounting has camera_turn in body axes: roll, pitch, yaw.
Fields mountingFields(const slam::Mounting& m) {
  Fields out = {{"steps", m.steps},
                {"camera_roll_pitch_yaw_rad", web::jsonOf(m.camera_turn)},
                {"camera_roll_pitch_yaw_sigma_rad", web::jsonOf(m.camera_turn_sigma)},
                {"dvl_scale", m.dvl_scale, "true distance over the DVL's, less 1",
                 withSigma(m.dvl_scale, m.dvl_scale_sigma, 5)},
                {"dvl_scale_sigma", m.dvl_scale_sigma},
                {"time_offset_s", m.time_offset, "images later than stamped [s]",
                 withSigma(m.time_offset, m.time_offset_sigma, 4)},
                {"time_offset_sigma_s", m.time_offset_sigma}};
  for (int i = 0; i < 3; ++i)
    out.push_back(web::onPage(
        std::string("camera against attitude sensor and DVL, ") + kAngles[i] + " [deg]",
        withSigma(m.camera_turn(i) / kRadiansPerDegree, m.camera_turn_sigma(i) / kRadiansPerDegree, 3)));
  return out;
}

Fields timingFields(const SensorTiming& t) {
  if (t.attitude_late == 0 && t.images_late == 0) return {};
  return {{"attitude_late_s", t.attitude_late},
          {"images_late_s", t.images_late},
          {"sigma_s", t.sigma},
          web::onPage(t.attitude_late != 0 ? "roll, pitch and heading later than stamped, taken out [s]"
                                           : "images later than stamped, taken out [s]",
                      withSigma(t.attitude_late + t.images_late, t.sigma, 3))};
}

Fields scaleFields(const ImageScale& s) {
  if (s.sigma == 0) return {};
  return {{"scale", s.scale, "ranges of the images multiplied, by the DVL's paths",
           withSigma(s.scale, s.sigma, 4)},
          {"sigma", s.sigma},
          {"steps", s.steps}};
}

Fields usblFields(const SlamResult::Usbl& u) {
  if (!u.sought) return {};
  return {{"shift_north_east_m", web::jsonOf(u.shift)},
          {"shift_sigma_m", web::jsonOf(u.shift_sigma)},
          {"turn_rad", u.turn, "USBL positions to be turned about their middle [deg]",
           withSigma(u.turn / kRadiansPerDegree, u.turn_sigma / kRadiansPerDegree, 2)},
          {"turn_sigma_rad", u.turn_sigma},
          web::onPage("USBL positions to be shifted north [m]", withSigma(u.shift.x(), u.shift_sigma.x(), 2)),
          web::onPage("USBL positions to be shifted east [m]", withSigma(u.shift.y(), u.shift_sigma.y(), 2))};
}

Fields bundleFields(const SlamResult::Bundled& b) {
  if (!b.done) return {};
  return {{"points", b.points, "points of the bundle adjustment"},
          {"sightings", b.sightings},
          {"links", b.links},
          {"pixel_rms_before", b.pixel_before, "reprojection error, rms, before [px]", 3},
          {"pixel_rms_after", b.pixel_after, "and after [px]", 3},
          {"moved_rms_m", b.moved_rms, "cameras moved by bundle adjustment, rms [mm]", 1, 1000}};
}

// Significant (over 4 sigma) and larger than the threshold `matters`, in the unit of `value`.
bool off(double value, double sigma, double matters) {
  constexpr double kSigmas = 4;
  return std::abs(value) > std::max(kSigmas * sigma, matters);
}

void warnOfTiming(const SensorTiming& t, std::vector<std::string>& warnings) {
  if (t.attitude_late != 0)
    warnings.push_back(
        "Roll, pitch and heading lag behind the images by " + withSigma(t.attitude_late, t.sigma, 2) +
        " s. This run takes that out; check compass_s in mission.toml, and the sensor's filter.");
  if (t.images_late != 0)
    warnings.push_back("Images were taken later than stamped, by " + withSigma(t.images_late, t.sigma, 2) +
                       " s. This run takes that out; check time offsets in mission.toml.");
}

void warnOfMounting(const slam::Mounting& m, std::vector<std::string>& warnings) {
  constexpr double kTurn = kRadiansPerDegree, kScale = 0.02, kOffset = 0.05;  // [rad], [1], [s]
  for (int i = 0; i < 3; ++i)
    if (off(m.camera_turn(i), m.camera_turn_sigma(i), kTurn))
      warnings.push_back(
          "The camera seems turned in " + std::string(kAngles[i]) + " by " +
          withSigma(m.camera_turn(i) / kRadiansPerDegree, m.camera_turn_sigma(i) / kRadiansPerDegree, 2) +
          " degrees against attitude sensor and DVL: check extrinsics in mission.toml.");
  if (off(m.dvl_scale, m.dvl_scale_sigma, kScale))
    warnings.push_back("Distances by DVL seem short by " +
                       withSigma(100 * m.dvl_scale, 100 * m.dvl_scale_sigma, 2) +
                       " percent: check the sound speed, and the cameras' baseline.");
  if (off(m.time_offset, m.time_offset_sigma, kOffset))
    warnings.push_back("Images seem taken later than stamped, by " +
                       withSigma(m.time_offset, m.time_offset_sigma, 3) +
                       " s: check time offsets in mission.toml.");
}

Json partsJson(const std::vector<SlamResult::Part>& parts) {
  Json out = Json::array();
  for (const SlamResult::Part& part : parts) {
    Json one{{"first_pair", part.pairs.front()}, {"pairs", part.pairs}, {"placed", part.placed}};
    if (part.why != closure::Refusal::kNone)
      one["not_joined_before"] = std::string(closure::nameOf(part.why));
    out.push_back(std::move(one));
  }
  return out;
}

// Why nothing joins a part's first pair to the one before it.
std::string reasonOf(closure::Refusal why) {
  if (why == closure::Refusal::kNone) return "";
  const std::string name(closure::nameOf(why));
  return why == closure::Refusal::kNoFeatures
             ? "shows too little: dark, blurred or bare (" + name + ")"
             : "too little in common: no overlap, too fast a motion, or bare ground (" + name + ")";
}

using web::Plot, web::Series;

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
  report.table({}, web::rowsOf(truthFields(c)));
}

}  // namespace

std::vector<std::string> slamWarnings(const SlamResult& s) {
  constexpr double kUnverified = 0.2, kFew = 5;  // share of the expected length; not significant below [m]
  std::vector<std::string> warnings;
  if (!s.converged)
    warnings.emplace_back(
        "Localisation did not converge: poses are the best that were found, their standard "
        "deviations are not to be relied on.");
  if (s.crossings_unverified > std::max(kFew, kUnverified * s.crossings_expected))
    warnings.push_back("Crossings expected but not verified: about " + decimals(s.crossings_unverified, 0) +
                       " m of the " + decimals(s.crossings_expected, 0) +
                       " m flown over ground seen before have no loop closure.");
  warnOfTiming(s.timing, warnings);
  warnOfMounting(s.mounting, warnings);
  for (std::string& warning : controlWarnings(s.control)) warnings.push_back(std::move(warning));
  const auto placed = static_cast<std::size_t>(
      std::count_if(s.parts.begin(), s.parts.end(), [](const SlamResult::Part& p) { return p.placed; }));
  if (s.parts.size() > 1)
    warnings.push_back(
        "Nothing joins the pairs of " + std::to_string(s.parts.size()) +
        " parts: each is a model of its own. " +
        (placed == s.parts.size() ? "They stand where navigation has them."
         : placed > 0             ? std::to_string(placed) +
                            " stand where navigation has them, the others side by side east of them, where "
                            "they are not in truth."
                      : "They stand side by side, west to east, where they are not in truth."));
  if (s.refused_tilt)
    warnings.push_back(
        "By the attitudes that were given the seafloor would slope by " +
        decimals(*s.refused_tilt / kRadiansPerDegree, 0) +
        " degrees: the cameras do not look straight down. Roll and pitch were not used; say how "
        "they look with --mount.");
  return warnings;
}

Fields slamFields(const SlamResult& s) {
  const auto removed = [](const std::vector<slam::NavigationLink>& links) {
    return std::count_if(links.begin(), links.end(), [](const slam::NavigationLink& l) { return !l.kept; });
  };
  const auto closures_removed = removed(s.closures);
  const auto reckoned = [&](const char* title) { return s.parts.empty() ? title : ""; };
  Fields refused;
  for (std::size_t k = 1; k < s.refused.size(); ++k) {
    const std::string cause(closure::nameOf(static_cast<closure::Refusal>(k)));
    refused.emplace_back(cause, s.refused[k], "refused: " + cause);
  }
  return {{"frames", s.frames, "pairs with features"},
          {"odometry_links", s.odometry.size(), "visual odometry links"},
          {"odometry_links_removed", removed(s.odometry)},
          {"closures_tried", s.tried.size(), "closures tried"},
          {"closures", s.closures.size(), "closures accepted"},
          {"closures_removed", closures_removed, "closures taken out again"},
          web::onPage("closures kept",
                      std::to_string(static_cast<std::ptrdiff_t>(s.closures.size()) - closures_removed)),
          {"closures_unconfirmed", s.unconfirmed, "closures left out: nothing confirmed them"},
          {"crossings_expected_m", s.crossings_expected, "ground seen before, expected [m of track]", 1},
          {"crossings_unverified_m", s.crossings_unverified, "of it without a closure [m]", 1},
          {"converged", s.converged},
          {"warnings", slamWarnings(s)},
          {"refused", refused},
          {"fixes_kept", s.fixes_kept, "fixes kept"},
          {"fixes_removed", s.fixes_removed, "fixes taken out"},
          {"steps_contradicted", s.sensors.steps_contradicted,
           reckoned("steps where visual odometry contradicts dead reckoning")},
          {"steps_without_bottom_track", s.sensors.dvl_absent, reckoned("steps without bottom track")},
          {"compass_jumps", s.sensors.compass_jumps, reckoned("leaps of the compass")},
          {"attitude_absent", s.sensors.attitude_absent},
          {"depth_absent", s.sensors.depth_absent},
          {"pairs_unjoined", s.unjoined, "pairs left out: nothing joins them to the others"},
          {"timing", timingFields(s.timing)},
          {"image_scale", scaleFields(s.scale)},
          {"mounting", mountingFields(s.mounting)},
          {"usbl", usblFields(s.usbl)},
          {"bundle", bundleFields(s.bundled)},
          {"control", controlJson(s.control)},
          {"moved_rms_m", s.moved_rms, reckoned("moved from dead reckoning, rms [m]"), 3},
          {"parts", partsJson(s.parts)},
          {"stage_s", s.seconds}};
}

Fields truthFields(const Consistency& c) {
  if (c.moments.empty()) return {};
  return {{"pairs", c.moments.size()},
          {"mean_squared_error_over_covariance", c.mean_squared,
           "mean squared error over covariance (6 expected), in nav", 2},
          {"mean_squared_error_over_covariance_since_first", c.mean_since_first, "from the first pair", 2},
          {"first", momentFields(c.moments.front())},
          {"middle", momentFields(c.moments[c.moments.size() / 2])},
          {"last", momentFields(c.moments.back())},
          {"share_below_95_percent", c.share_inside},
          {"mean_squared_error_over_covariance_of_odometry", c.mean_squared_odometry},
          {"mean_squared_error_over_covariance_of_closures", c.mean_squared_closures},
          {"false_closures", c.false_closures, "false closures"},
          {"false_closures_kept", c.false_closures_kept},
          {"pairs_overlapping", c.overlapping, "pairs that overlap by more than 30 %"},
          {"pairs_overlapping_tried", c.overlapping_tried, "of them tried"},
          {"pairs_overlapping_accepted", c.overlapping_accepted, "of them accepted"}};
}

void addParts(web::ReportPage& report, const std::vector<SlamResult::Part>& parts,
              const std::vector<ImagePair>& pairs) {
  if (parts.size() < 2) return;
  report.section("Parts");
  report.text("Each stands for itself: distances from one to another mean nothing.");
  std::vector<web::Row> rows;
  for (const SlamResult::Part& part : parts)
    rows.push_back({rows.size() + 1, part.pairs.size(), pairs[part.pairs.front()].left,
                    pairs[part.pairs.back()].left, reasonOf(part.why)});
  report.table({"part, west to east", "pairs", "first image", "last image", "not joined to the image before"},
               rows);
}

void writeSlamReport(const std::filesystem::path& folder, const SlamResult& slam,
                     const Navigation& navigation, const SE3& T_body_cam, bool features_only,
                     const Consistency& truth) {
  Fields fields = slamFields(slam);
  fields.emplace_back("truth", truthFields(truth));
  writeFile(folder / "slam.json", web::jsonOf(fields).dump(2) + "\n");
  web::ReportPage report("Localisation",
                         features_only ? "A mission without images: features that were matched before." : "");
  for (const std::string& warning : slamWarnings(slam)) report.warning(warning);
  report.section("Tracks");
  report.plot(tracksPlot(navigation, slam));
  report.section("Misregistration where the vehicle came back");
  addClosureErrors(report, closureErrors(slam.closures, navigation.poses, T_body_cam),
                   closureErrors(slam.closures, slam.poses, T_body_cam));
  report.section("Counts");
  report.table({}, web::rowsOf(slamFields(slam)));
  addControl(report, slam.control);
  report.section("Against the truth");
  addTruth(report, truth);
  report.section("Seconds");
  std::vector<web::Row> stages;
  for (const auto& [stage, seconds] : slam.seconds) stages.push_back({stage, decimals(seconds, 2)});
  report.table({}, stages);
  report.write(folder / "slam.html");
}

}  // namespace fathom::topside

#include "recon/topside/report/slam_json.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/report/control_report.hpp"
#include "recon/topside/report/json_values.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kAngles[] = {"roll", "pitch", "yaw"};

// Estimate less truth and estimated standard deviation in nav axes (north, east, down); rotation about these.
Json momentJson(const Consistency::Moment& m) {
  return {{"time_s", m.time_s},
          {"error_m", jsonOf(m.position)},
          {"sigma_m", jsonOf(m.sigma_position)},
          {"turn_error_rad", jsonOf(m.turn)},
          {"turn_sigma_rad", jsonOf(m.sigma_turn)},
          {"squared_error_over_covariance", m.squared},
          {"squared_error_over_covariance_since_first", m.since_first}};
}

// SlamResult::mounting has camera_turn in body axes: roll, pitch, yaw.
Json mountingJson(const slam::Mounting& m) {
  return {{"steps", m.steps},
          {"camera_roll_pitch_yaw_rad", jsonOf(m.camera_turn)},
          {"camera_roll_pitch_yaw_sigma_rad", jsonOf(m.camera_turn_sigma)},
          {"dvl_scale", m.dvl_scale},
          {"dvl_scale_sigma", m.dvl_scale_sigma},
          {"time_offset_s", m.time_offset},
          {"time_offset_sigma_s", m.time_offset_sigma}};
}

Json usblJson(const SlamResult::Usbl& u) {
  if (!u.sought) return nullptr;
  return {{"shift_north_east_m", {u.shift.x(), u.shift.y()}},
          {"shift_sigma_m", {u.shift_sigma.x(), u.shift_sigma.y()}},
          {"turn_rad", u.turn},
          {"turn_sigma_rad", u.turn_sigma}};
}

Json bundleJson(const SlamResult::Bundled& b) {
  if (!b.done) return nullptr;
  return {{"points", b.points},
          {"sightings", b.sightings},
          {"links", b.links},
          {"pixel_rms_before", b.pixel_before},
          {"pixel_rms_after", b.pixel_after},
          {"moved_rms_m", b.moved_rms}};
}

std::string withSigma(double value, double sigma, int digits) {
  return decimals(value, digits) + " (standard deviation " + decimals(sigma, digits) + ")";
}

// Significant (over 4 sigma) and larger than the threshold `matters`, in the unit of `value`.
bool off(double value, double sigma, double matters) {
  constexpr double kSigmas = 4;
  return std::abs(value) > std::max(kSigmas * sigma, matters);
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

}  // namespace

std::vector<std::pair<std::string, std::string>> bundleRows(const SlamResult& s) {
  const SlamResult::Bundled& b = s.bundled;
  if (!b.done) return {};
  return {{"points of the bundle adjustment", std::to_string(b.points)},
          {"reprojection error, rms, before and after",
           decimals(b.pixel_before, 3) + " and " + decimals(b.pixel_after, 3) + " px"},
          {"cameras moved by bundle adjustment", decimals(1000 * b.moved_rms, 1) + " mm rms"}};
}

std::vector<std::pair<std::string, std::string>> calibrationRows(const SlamResult& s) {
  const slam::Mounting& m = s.mounting;
  const SlamResult::Usbl& u = s.usbl;
  std::vector<std::pair<std::string, std::string>> rows;
  for (int i = 0; i < 3; ++i)
    rows.emplace_back(
        std::string("camera against attitude sensor and DVL, ") + kAngles[i] + " [deg]",
        withSigma(m.camera_turn(i) / kRadiansPerDegree, m.camera_turn_sigma(i) / kRadiansPerDegree, 3));
  rows.emplace_back("true distance over the DVL's, less 1", withSigma(m.dvl_scale, m.dvl_scale_sigma, 5));
  rows.emplace_back("images later than stamped [s]", withSigma(m.time_offset, m.time_offset_sigma, 4));
  if (!u.sought) return rows;
  rows.emplace_back("USBL positions to be shifted north [m]", withSigma(u.shift.x(), u.shift_sigma.x(), 2));
  rows.emplace_back("USBL positions to be shifted east [m]", withSigma(u.shift.y(), u.shift_sigma.y(), 2));
  rows.emplace_back("USBL positions to be turned about their middle [deg]",
                    withSigma(u.turn / kRadiansPerDegree, u.turn_sigma / kRadiansPerDegree, 2));
  return rows;
}

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

Json slamJson(const SlamResult& s) {
  const auto removed = [](const std::vector<slam::NavigationLink>& links) {
    return std::count_if(links.begin(), links.end(), [](const slam::NavigationLink& l) { return !l.kept; });
  };
  Json refused = Json::object();
  for (std::size_t k = 1; k < s.refused.size(); ++k)
    refused[std::string(closure::nameOf(static_cast<closure::Refusal>(k)))] = s.refused[k];
  return {{"frames", s.frames},
          {"odometry_links", s.odometry.size()},
          {"odometry_links_removed", removed(s.odometry)},
          {"closures_tried", s.tried.size()},
          {"closures", s.closures.size()},
          {"closures_removed", removed(s.closures)},
          {"closures_unconfirmed", s.unconfirmed},
          {"crossings_expected_m", s.crossings_expected},
          {"crossings_unverified_m", s.crossings_unverified},
          {"converged", s.converged},
          {"warnings", slamWarnings(s)},
          {"refused", refused},
          {"fixes_kept", s.fixes_kept},
          {"fixes_removed", s.fixes_removed},
          {"steps_contradicted", s.sensors.steps_contradicted},
          {"steps_without_bottom_track", s.sensors.dvl_absent},
          {"compass_jumps", s.sensors.compass_jumps},
          {"attitude_absent", s.sensors.attitude_absent},
          {"depth_absent", s.sensors.depth_absent},
          {"mounting", mountingJson(s.mounting)},
          {"usbl", usblJson(s.usbl)},
          {"bundle", bundleJson(s.bundled)},
          {"control", controlJson(s.control)},
          {"moved_rms_m", s.moved_rms},
          {"parts", partsJson(s.parts)},
          {"stage_s", s.seconds}};
}

Json truthJson(const Consistency& c) {
  if (c.moments.empty()) return nullptr;
  return {{"pairs", c.moments.size()},
          {"mean_squared_error_over_covariance", c.mean_squared},
          {"mean_squared_error_over_covariance_since_first", c.mean_since_first},
          {"first", momentJson(c.moments.front())},
          {"middle", momentJson(c.moments[c.moments.size() / 2])},
          {"last", momentJson(c.moments.back())},
          {"share_below_95_percent", c.share_inside},
          {"mean_squared_error_over_covariance_of_odometry", c.mean_squared_odometry},
          {"mean_squared_error_over_covariance_of_closures", c.mean_squared_closures},
          {"false_closures", c.false_closures},
          {"false_closures_kept", c.false_closures_kept},
          {"pairs_overlapping", c.overlapping},
          {"pairs_overlapping_tried", c.overlapping_tried},
          {"pairs_overlapping_accepted", c.overlapping_accepted}};
}

}  // namespace fathom::topside

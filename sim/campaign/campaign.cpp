#include "sim/campaign/campaign.hpp"

#include <atomic>
#include <chrono>
#include <cmath>
#include <fstream>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "sim/hil/bench/child_process.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "sim/score/score.hpp"

namespace fathom::sim {
namespace {

constexpr double kAllDive = 1e5;  // [s]

constexpr bool kPictures = true, kFeatures = false;  // of the dive

std::vector<Perturbation> makePerturbations() {
  std::vector<Perturbation> all;
  const auto add = [&](const char* name, const char* unit, std::array<double, Perturbation::kLevels> levels,
                       bool pictures, void (*disturb)(Scenario&, double)) {
    all.push_back({name, unit, levels, pictures, disturb});
  };
  add("cameras turned against each other", "deg", {0.1, 0.3, 1, 3}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.rig_angle = degreesToRadians(v); });
  add("focal lengths off", "%", {0.1, 0.5, 2, 5}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.focal = v / 100; });
  add("sensors' mounting off", "deg", {0.2, 1, 3, 10}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.mounting_angle = degreesToRadians(v); });
  add("lever arms off", "m", {0.005, 0.02, 0.1, 0.5}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.lever_arm_m = v; });
  add("stamps off", "s", {0.005, 0.03, 0.1, 0.5}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.time_s = v; });
  add("right shutter late", "s", {0.001, 0.004, 0.02, 0.05}, kPictures,
      [](Scenario& s, double v) { s.sensors.cameras.right_delay_s = v; });
  add("marine snow", "1/m3", {500, 3000, 10000, 50000}, kPictures,
      [](Scenario& s, double v) { s.optics.water.snow_per_m3 = v; });
  add("water more turbid", "times", {1.5, 3, 6, 12}, kPictures, [](Scenario& s, double v) {
    for (double& b : s.optics.water.scattering_per_m) b *= v;
  });
  add("patches of sediment", "times", {0.5, 1.5, 4, 10}, kPictures,
      [](Scenario& s, double v) { s.optics.water.patches = v; });
  add("silt raised", "times", {2, 5, 15, 50}, kPictures, [](Scenario& s, double v) {
    s.optics.water.silt = {{60, v, 20}};
  });
  add("forward scatter", "1/m", {0.05, 0.2, 0.6, 1.5}, kPictures,
      [](Scenario& s, double v) { s.optics.water.forward_per_m = v; });
  add("sun with caustics", "1", {0.02, 0.08, 0.3, 1}, kPictures,
      [](Scenario& s, double v) { s.optics.daylight.irradiance = v, s.optics.daylight.caustics = 0.6; });
  add("strobes vary", "%", {5, 15, 40, 80}, kPictures,
      [](Scenario& s, double v) { s.optics.flash_sigma = v / 100; });
  add("a strobe misfires", "%", {1, 5, 20, 60}, kPictures,
      [](Scenario& s, double v) { s.optics.misfire_probability = v / 100; });
  add("pairs dark", "%", {1, 5, 20, 50}, kPictures,
      [](Scenario& s, double v) { s.optics.dark_probability = v / 100; });
  add("light too weak", "times", {0.5, 0.2, 0.05, 0.01}, kPictures,
      [](Scenario& s, double v) { s.optics.sensor.exposure *= v; });
  add("motion blur", "s", {0.002, 0.008, 0.03, 0.1}, kPictures,
      [](Scenario& s, double v) { s.optics.sensor.open_s = v; });
  add("out of focus (aperture)", "mm", {3, 10, 25, 50}, kPictures,
      [](Scenario& s, double v) { s.optics.sensor.aperture_mm = v, s.optics.sensor.focus_m = 1; });
  add("fish", "1", {3, 15, 60, 300}, kPictures,
      [](Scenario& s, double v) { s.terrain.fish = static_cast<int>(v); });
  add("sea grass that sways", "1/m2", {0.5, 3, 15, 60}, kPictures,
      [](Scenario& s, double v) { s.terrain.swaying_density_per_m2 = v; });
  add("ground without texture", "1", {0.1, 0.05, 0.02, 0.005}, kPictures, [](Scenario& s, double v) {
    s.terrain.detail_contrast = v, s.terrain.roughness_m = 0.1 * v, s.terrain.ripples.height_m = 0.1 * v;
    s.terrain.rubble.density_per_m2 = s.terrain.boulders.density_per_m2 = s.terrain.corals.density_per_m2 = 0;
  });
  add("magnetic anomaly", "deg", {3, 10, 30, 90}, kFeatures, [](Scenario& s, double v) {
    s.sensors.compass.anomalies = {{0.5, 0.5, 2.5, degreesToRadians(v)}};
  });
  add("compass jumps", "deg", {3, 10, 30, 90}, kFeatures, [](Scenario& s, double v) {
    s.sensors.compass.jumps = {{80, degreesToRadians(v)}};
  });
  add("soft iron", "deg", {1, 3, 10, 30}, kFeatures,
      [](Scenario& s, double v) { s.sensors.compass.soft_iron = degreesToRadians(v); });
  add("compass lags", "s", {0.1, 0.3, 1, 5}, kFeatures,
      [](Scenario& s, double v) { s.sensors.compass.lag_s = v; });
  add("DVL silent", "s", {5, 20, 60, 300}, kFeatures, [](Scenario& s, double v) {
    s.sensors.dvl.outages = {{70, 70 + v}};
  });
  add("DVL stuck", "s", {5, 20, 60, 300}, kFeatures, [](Scenario& s, double v) {
    s.sensors.dvl.stuck = {{70, 70 + v}};
  });
  add("DVL on a false bottom", "s", {5, 20, 60, 300}, kFeatures, [](Scenario& s, double v) {
    s.sensors.dvl.false_bottom = {{70, 70 + v}};
    s.sensors.dvl.current_east_mps = 0.2;
  });
  add("fish in the DVL's beams", "%", {1, 5, 20, 60}, kFeatures,
      [](Scenario& s, double v) { s.sensors.dvl.fish_probability = v / 100; });
  add("DVL noisier", "times", {3, 10, 30, 100}, kFeatures,
      [](Scenario& s, double v) { s.sensors.dvl.velocity_sigma_mps *= v; });
  add("USBL multipath", "m", {2, 8, 30, 200}, kFeatures, [](Scenario& s, double v) {
    s.sensors.usbl.multipath = {UsblErrorBurst{{80, kAllDive}, v, -0.5 * v}};
  });
  add("ship's compass wanders", "deg", {1, 3, 10, 20}, kFeatures,
      [](Scenario& s, double v) { s.sensors.usbl.heading_wobble = degreesToRadians(v); });
  add("samples late and in batches", "s", {0.05, 0.2, 1, 3}, kFeatures, [](Scenario& s, double v) {
    s.sensors.arrival = {.jitter_s = 0.5 * v, .batch_s = v, .stamp_jitter_s = 0};
  });
  add("stamps jitter", "s", {0.005, 0.02, 0.1, 0.5}, kFeatures,
      [](Scenario& s, double v) { s.sensors.arrival.stamp_jitter_s = v; });
  add("something hits the hull", "m", {0.05, 0.2, 0.6, 2}, kFeatures, [](Scenario& s, double v) {
    s.vehicle.collisions = {{80, v, degreesToRadians(60 * v), 4}};
  });
  add("hovers", "s", {10, 30, 60, 120}, kFeatures, [](Scenario& s, double v) {
    s.vehicle.hovers = {{80, v}};
  });
  return all;
}

using Json = nlohmann::ordered_json;
constexpr std::size_t kUndisturbed = 2;
constexpr double kTimeLimit_s = 900;  // of one program over one dive

double number(const Json& json, const char* key) {
  return json.contains(key) && json[key].is_number() ? json[key].get<double>() : NAN;
}

// Visits the measured numbers of a result by their JSON keys; NaN is null in the file.
template <typename Dive, typename Visit>
void eachNumber(Dive& d, const Visit& visit) {
  visit("onboard_surface_m", d.onboard_surface_m);
  visit("topside_surface_m", d.topside_surface_m);
  visit("onboard_coverage", d.onboard_coverage);
  visit("topside_coverage", d.topside_coverage);
  visit("onboard_track_m", d.onboard_track_m);
  visit("topside_track_m", d.topside_track_m);
  visit("nees", d.nees);
  visit("inside", d.inside);
  visit("seconds", d.seconds);
}

Json jsonOf(const DiveResult& d) {
  Json json = {{"dive", d.dive},
               {"perturbation", d.perturbation},
               {"level", d.level},
               {"pictures", d.pictures},
               {"onboard_map", d.onboard_map},
               {"topside_map", d.topside_map},
               {"false_closures", d.false_closures},
               {"trouble", d.trouble}};
  eachNumber(d, [&](const char* key, double v) { json[key] = std::isfinite(v) ? Json(v) : Json(); });
  return json;
}

DiveResult resultOf(const Json& json) {
  DiveResult d = planOf(json.at("dive").get<std::size_t>());
  d.onboard_map = json.at("onboard_map"), d.topside_map = json.at("topside_map");
  d.false_closures = json.at("false_closures");
  d.trouble = json.at("trouble").get<std::string>();
  eachNumber(d, [&](const char* key, double& v) { v = number(json, key); });
  return d;
}

// Runs a program to its end; the last line of its output when it fails, else none.
std::optional<std::string> runLogged(const std::vector<std::string>& argv, const std::filesystem::path& log) {
  ChildProcess child({.argv = argv, .environment = {}, .output = log, .cable = {}});
  const auto status = child.wait(kTimeLimit_s);
  if (status == 0) return std::nullopt;
  if (!status) return argv[0] + ": did not end in " + formatted("%.0f s", kTimeLimit_s);
  std::ifstream text(log);
  std::string last;
  for (std::string line; std::getline(text, line);)
    if (!line.empty()) last = line.substr(line.rfind('\r') == std::string::npos ? 0 : line.rfind('\r') + 1);
  return last;
}

void score(const std::filesystem::path& mission, DiveResult& d) {
  const ScoreReport report = scoreMission(mission);
  if (report.onboard) d.onboard_track_m = report.onboard->aligned_rms_m.value_or(NAN);
  if (report.topside) d.topside_track_m = report.topside->aligned_rms_m.value_or(NAN);
  if (report.onboard_surface) {
    d.onboard_surface_m = report.onboard_surface->aligned_rms_m;
    d.onboard_coverage = report.onboard_surface->coverage;
  }
  if (report.topside_surface) {
    d.topside_surface_m = report.topside_surface->aligned_rms_m;
    d.topside_coverage = report.topside_surface->coverage;
  }
}

DiveResult dive(const CampaignOptions& options, std::size_t index) {
  const auto begin = std::chrono::steady_clock::now();
  DiveResult d = planOf(index);
  const std::filesystem::path folder = options.out / ("dive-" + std::to_string(index)),
                              mission = folder / "mission";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  try {
    MissionMakerOptions maker;
    maker.out = mission;
    maker.threads = 1;
    maker.features = !d.pictures;
    makeMission(diveScenario(options, index), maker);
    const std::string onboard = (options.programs / "fathom-onboard").string(),
                      topside = (options.programs / "fathom-topside").string();
    const auto failed = [&](const std::vector<std::string>& argv, const char* log) {
      const auto trouble = runLogged(argv, folder / log);
      if (trouble) d.trouble += (d.trouble.empty() ? "" : "; ") + *trouble;
      return trouble.has_value();
    };
    d.onboard_map = !failed({onboard, "--replay", mission.string()}, "onboard.log");
    d.topside_map = !d.pictures || !failed({topside, "run", mission.string(), "--jobs", "1"}, "topside.log");
    const bool posed = !failed({topside, "slam", mission.string(), "--jobs", "1"}, "slam.log");
    d.topside_map = d.topside_map && posed;
    score(mission, d);
    if (posed) {
      const Json truth = Json::parse(std::ifstream(mission / "slam" / "slam.json")).at("truth");
      d.nees = number(truth, "mean_squared_error_over_covariance");
      d.inside = number(truth, "share_below_95_percent");
      d.false_closures = truth.value("false_closures_kept", std::size_t{0});
    }
  } catch (const std::exception& error) {
    d.trouble += (d.trouble.empty() ? "" : "; ") + std::string(error.what());
  }
  if (!options.only) std::filesystem::remove_all(folder);
  d.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return d;
}

// Results in the file by dive number; an incomplete last line is ignored.
std::map<std::size_t, DiveResult> resultsIn(const std::filesystem::path& file) {
  std::map<std::size_t, DiveResult> out;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    const Json json = Json::parse(line, nullptr, false);
    if (json.is_object() && json.contains("seconds")) out[json.at("dive")] = resultOf(json);
  }
  return out;
}

}  // namespace

std::span<const Perturbation> perturbations() {
  static const std::vector<Perturbation> kPerturbations = makePerturbations();
  return kPerturbations;
}

DiveResult planOf(std::size_t dive) {
  DiveResult d;
  d.dive = dive;
  d.pictures = dive != 1;
  if (dive < kUndisturbed) return d;
  const std::size_t count = perturbations().size(), k = dive - kUndisturbed;
  d.perturbation = static_cast<int>(k % count);
  d.level = static_cast<int>(k / count % Perturbation::kLevels);
  d.pictures = perturbations()[k % count].pictures;
  return d;
}

Scenario diveScenario(const CampaignOptions& options, std::size_t dive) {
  const DiveResult plan = planOf(dive);
  Scenario scenario = loadScenario("campaign");
  // Undisturbed dives and the first round share one terrain; every further round has its own.
  const std::size_t round =
      dive < kUndisturbed ? 0 : (dive - kUndisturbed) / (perturbations().size() * Perturbation::kLevels);
  scenario.seed = static_cast<std::int64_t>(1000 * options.seed + dive);
  scenario.terrain.seed += round;
  if (!plan.pictures) {
    scenario.plan.lines = 4;
    scenario.plan.line_length = 6;
    scenario.plan.cross_lines = 2;
    scenario.terrain.size_north_m = scenario.terrain.size_east_m = 14;
  }
  if (plan.perturbation >= 0) {
    const Perturbation& p = perturbations()[static_cast<std::size_t>(plan.perturbation)];
    p.disturb(scenario, p.levels[static_cast<std::size_t>(plan.level)]);
  }
  return scenario;
}

std::vector<std::string> failedRequirements(const DiveResult& d, const DiveResult& undisturbed) {
  constexpr double kCoverage = 0.9, kSurface = 0.033, kTrack = 3, kNees = 22.46, kLeastTrack = 0.03;
  std::vector<std::string> out;
  const auto judge = [&](bool bad, const char* what) {
    if (bad) out.emplace_back(what);
  };
  judge(!d.onboard_map, "no map on board");
  judge(!d.topside_map, d.pictures ? "no map topside" : "no poses topside");
  judge(d.onboard_coverage < kCoverage * undisturbed.onboard_coverage, "coverage on board");
  judge(d.topside_coverage < kCoverage * undisturbed.topside_coverage, "coverage topside");
  judge(d.topside_surface_m > kSurface, "surface topside");
  judge(d.onboard_surface_m > 2 * kSurface, "surface on board");
  judge(!d.pictures && d.onboard_track_m > std::max(kLeastTrack, kTrack * undisturbed.onboard_track_m),
        "track on board");
  judge(d.nees > kNees,
        "poses worse than their covariance");  // 99.9 % of chi-square with 6 degrees of freedom
  judge(d.false_closures > 0, "false closure");
  return out;
}

std::vector<DiveResult> runCampaign(const CampaignOptions& options) {
  for (const char* program : {"fathom-onboard", "fathom-topside"})
    if (!std::filesystem::exists(options.programs / program))
      throw InputError((options.programs / program).string(), "", "is absent; name its folder by --programs");
  const std::filesystem::path file = options.out / "results.jsonl";
  if (std::filesystem::exists(options.out) && !std::filesystem::is_empty(options.out) &&
      !std::filesystem::exists(file))
    throw InputError(options.out.string(), "", "holds something else than a campaign; name another folder");
  std::filesystem::create_directories(options.out);
  std::map<std::size_t, DiveResult> done = resultsIn(file);
  std::vector<std::size_t> wanted;
  for (std::size_t k = 0; k < options.dives; ++k)
    if (options.only ? k == *options.only : !done.contains(k)) wanted.push_back(k);
  if (options.only && wanted.empty()) wanted.push_back(*options.only);
  std::ofstream results(file, std::ios::app);
  std::atomic<std::size_t> next = 0;
  std::size_t dived = 0;
  std::mutex mutex;
  const auto work = [&] {
    for (std::size_t k = next++; k < wanted.size(); k = next++) {
      const DiveResult d = dive(options, wanted[k]);
      const std::lock_guard lock(mutex);
      done[d.dive] = d;
      results << jsonOf(d).dump() << std::endl;
      if (options.progress) options.progress(++dived, wanted.size());
    }
  };
  std::vector<std::jthread> threads;
  for (int j = 0; j < std::max(1, options.jobs); ++j) threads.emplace_back(work);
  threads.clear();
  std::vector<DiveResult> out;
  for (const auto& [index, d] : done) out.push_back(d);
  writeCampaignPage(options.out / "campaign.html", out, options.seed);
  return out;
}

}  // namespace fathom::sim

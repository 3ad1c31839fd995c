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
#include "sim/hil/bench/child_process.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "sim/score/score.hpp"

namespace fathom::sim {
namespace {

using Json = nlohmann::ordered_json;
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
  visit("topside_surface_squares", d.topside_surface_squares);
  visit("colour_median", d.colour_median);
  visit("colour_p95", d.colour_p95);
  visit("nees", d.nees);
  visit("inside", d.inside);
  visit("seconds", d.seconds);
}

Json jsonOf(const DiveResult& d, std::uint64_t seed) {
  Json json = {{"dive", d.plan.dive},
               {"series", nameOf(d.plan.series)},
               {"seed", seed},
               {"perturbation", d.plan.perturbation},
               {"level", d.plan.level},
               {"pictures", d.plan.pictures},
               {"onboard_map", d.onboard_map},
               {"topside_map", d.topside_map},
               {"false_closures", d.false_closures},
               {"trouble", d.trouble}};
  eachNumber(d, [&](const char* key, double v) { json[key] = std::isfinite(v) ? Json(v) : Json(); });
  return json;
}

DiveResult resultOf(DiveSeries series, const Json& json) {
  DiveResult d;
  d.plan = planOf(series, json.at("dive").get<std::size_t>());
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
  for (const auto& [product, colours] : report.colours)
    if (product == "mesh.ply") d.colour_median = colours.median, d.colour_p95 = colours.p95;
  if (report.topside_surface) {
    d.topside_surface_m = report.topside_surface->aligned_rms_m;
    d.topside_surface_squares = report.topside_surface->squared_over_variance.value_or(NAN);
    d.topside_coverage = report.topside_surface->coverage;
  }
}

DiveResult dive(const CampaignOptions& options, std::size_t index) {
  const auto begin = std::chrono::steady_clock::now();
  DiveResult d;
  d.plan = planOf(options.series, index);
  const bool pictures = d.plan.pictures;
  const std::filesystem::path folder = options.out / ("dive-" + std::to_string(index)),
                              mission = folder / "mission";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  try {
    MissionMakerOptions maker;
    maker.out = mission;
    maker.threads = 1;
    maker.features = !pictures;
    makeMission(diveScenario(d.plan, options.seed), maker);
    const std::string onboard = (options.programs / "fathom-onboard").string(),
                      topside = (options.programs / "fathom-topside").string();
    const auto failed = [&](const std::vector<std::string>& argv, const char* log) {
      const auto trouble = runLogged(argv, folder / log);
      if (trouble) d.trouble += (d.trouble.empty() ? "" : "; ") + *trouble;
      return trouble.has_value();
    };
    d.onboard_map = !failed({onboard, "--replay", mission.string()}, "onboard.log");
    d.topside_map = !pictures || !failed({topside, "run", mission.string(), "--jobs", "1"}, "topside.log");
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
std::map<std::size_t, DiveResult> resultsIn(const std::filesystem::path& file,
                                            const CampaignOptions& options) {
  std::map<std::size_t, DiveResult> out;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    const Json json = Json::parse(line, nullptr, false);
    if (!json.is_object() || !json.contains("seconds")) continue;
    if (json.value("series", "") != nameOf(options.series) ||
        json.value("seed", std::uint64_t{0}) != options.seed)
      throw InputError(file.string(), "", "holds dives of another series or seed; name another folder");
    out[json.at("dive")] = resultOf(options.series, json);
  }
  return out;
}

}  // namespace

Requirements requirementsOf(DiveSeries series) {
  if (series == DiveSeries::kSingle)
    return {.coverage = 0.9, .surface_m = 0.033, .onboard_m = 0.066, .colour_p95 = INFINITY};
  return {.coverage = 0.95, .surface_m = 0.025, .onboard_m = 0.05, .colour_p95 = 8};
}

std::vector<std::string> failedRequirements(const DiveResult& d, const DiveResult& undisturbed) {
  constexpr double kTrack = 3, kLeastTrack = 0.03;
  const Requirements wanted = requirementsOf(d.plan.series);
  const bool pictures = d.plan.pictures;
  std::vector<std::string> out;
  const auto judge = [&](bool bad, const char* what) {
    if (bad) out.emplace_back(what);
  };
  judge(!d.onboard_map, "no map on board");
  judge(!d.topside_map, pictures ? "no map topside" : "no poses topside");
  judge(d.onboard_coverage < wanted.coverage * undisturbed.onboard_coverage, "coverage on board");
  judge(d.topside_coverage < wanted.coverage * undisturbed.topside_coverage, "coverage topside");
  judge(d.topside_surface_m > wanted.surface_m, "surface topside");
  judge(d.onboard_surface_m > wanted.onboard_m, "surface on board");
  judge(d.colour_p95 > wanted.colour_p95, "colours");
  judge(!pictures && d.onboard_track_m > std::max(kLeastTrack, kTrack * undisturbed.onboard_track_m),
        "track on board");
  judge(d.nees > kWorstNees, "poses worse than their covariance");
  judge(d.false_closures > 0, "false closure");
  return out;
}

std::vector<DiveResult> runCampaign(const CampaignOptions& options) {
  for (const char* program : {"fathom-onboard", "fathom-topside"})
    if (!std::filesystem::exists(options.programs / program))
      throw InputError((options.programs / program).string(), "", "is absent; name its folder by --programs");
  const std::size_t sites = options.series == DiveSeries::kSingle ? 1 : kSites;
  for (std::size_t site = 0; site < sites; ++site)
    static_cast<void>(resolvedTerrain(diveScenario(planOf(options.series, site), options.seed)));
  const std::filesystem::path file = options.out / "results.jsonl";

  if (std::filesystem::exists(options.out) && !std::filesystem::is_empty(options.out) &&
      !std::filesystem::exists(file))
    throw InputError(options.out.string(), "", "holds something else than a campaign; name another folder");
  std::filesystem::create_directories(options.out);
  std::map<std::size_t, DiveResult> done = resultsIn(file, options);
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
      done[d.plan.dive] = d;
      results << jsonOf(d, options.seed).dump() << std::endl;
      if (options.progress) options.progress(++dived, wanted.size());
    }
  };
  std::vector<std::jthread> threads;
  for (int j = 0; j < std::max(1, options.jobs); ++j) threads.emplace_back(work);
  threads.clear();
  std::vector<DiveResult> out;
  for (const auto& [index, d] : done) out.push_back(d);
  writeCampaignPage(options, out);
  return out;
}

}  // namespace fathom::sim

#include "sim/render_command.hpp"

#include <algorithm>
#include <cstdio>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/text.hpp"
#include "realtime/kernel/progress.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"

namespace fathom::sim {
namespace {

void requireRange(const char* option, double value, double low, double high) {
  if (value >= low && value <= high) return;
  throw InputError(option, "", formatted("is out of range; give a number from %g to %g", low, high));
}

}  // namespace

int runRender(const RenderOptions& options) {
  Scenario scenario = loadScenario(options.scenario);
  if (options.seed) {
    requireRange("--seed", static_cast<double>(*options.seed), 0, 9007199254740992.0);
    scenario.seed = *options.seed;
  }
  if (options.duration_s) {
    requireRange("--duration", *options.duration_s, 1, kLongestSurvey);
    scenario.longest_survey_s = std::min(scenario.longest_survey_s, *options.duration_s);
  }
  if (options.rate_hz) {
    requireRange("--rate", *options.rate_hz, 0.1, 30);
    scenario.sensors.cameras.rate_hz = *options.rate_hz;
  }
  if (options.scale) {
    requireRange("--scale", *options.scale, 0.05, 1);
    scenario.scale = *options.scale;
  }
  MissionMakerOptions maker;
  maker.out = options.out;
  maker.force = options.force;
  maker.threads = options.threads;
  maker.features = options.features;
  rt::ProgressBar bar;
  maker.progress = [&bar](std::size_t done, std::size_t total) { bar.show(done, total, "pairs"); };
  const MissionMakerReport report = makeMission(scenario, maker);
  std::printf("%s: %zu pairs in %.0f s over %.1f m, altitude %.1f to %.1f m, %zu log entries\n",
              options.out.c_str(), report.pairs, report.survey_s, report.track_m, report.lowest_m,
              report.highest_m, report.samples);
  return kExitSuccess;
}

int runKeys(const std::string& scenario) {
  std::fputs(scenarioToml(scenario.empty() ? Scenario() : loadScenario(scenario)).c_str(), stdout);
  return kExitSuccess;
}

}  // namespace fathom::sim

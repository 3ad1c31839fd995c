#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/progress.hpp"
#include "realtime/kernel/text.hpp"
#include "sim/commands.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"

namespace fathom::sim {
namespace {

struct RenderOptions {
  std::string scenario;              // a path or a shipped name
  std::optional<std::int64_t> seed;  // these replace the scenario's own
  std::optional<double> duration_s;  // longest survey
  std::optional<double> scale;       // of the images' sides
  std::optional<double> rate_hz;     // of pairs
  MissionMakerOptions maker;
};

void requireRange(const char* option, double value, double low, double high) {
  if (value >= low && value <= high) return;
  throw InputError(option, "", formatted("is out of range; give a number from %g to %g", low, high));
}

int render(RenderOptions& options) {
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
  rt::ProgressBar bar;
  options.maker.progress = [&bar](std::size_t done, std::size_t total) { bar.show(done, total, "pairs"); };
  const MissionMakerReport report = makeMission(scenario, options.maker);
  std::printf("%s: %zu pairs in %.0f s over %.1f m, altitude %.1f to %.1f m, %zu log entries\n",
              options.maker.out.c_str(), report.pairs, report.survey_s, report.track_m, report.lowest_m,
              report.highest_m, report.samples);
  return kExitSuccess;
}

}  // namespace

Command addRenderCommand(CLI::App& app) {
  const auto options = std::make_shared<RenderOptions>();
  CLI::App* command = app.add_subcommand("render", "make a mission folder from a scenario");
  command->footer("Example: fathom-sim render reef-grid --out missions/reef-grid --scale 0.5");
  command->add_option("scenario", options->scenario, "TOML file, or the name of a shipped scenario")
      ->required();
  command->add_option("--out", options->maker.out, "mission folder to make")->required();
  command->add_option("--seed", options->seed, "instead of the scenario's own");
  command->add_option("--duration", options->duration_s, "cut the survey after this [s]");
  command->add_option("--scale", options->scale, "of the images' sides, 0.05 to 1");
  command->add_option("--rate", options->rate_hz, "pairs a second, 0.1 to 30");
  command->add_option("--threads", options->maker.threads, "0: all")->check(CLI::Range(0, 1024));
  command->add_flag("--features", options->maker.features,
                    "write what stereo would match instead of pictures: missions of hours in minutes");
  command->add_flag("--force", options->maker.force, "replace a folder that is not empty");
  return {command, [options] { return render(*options); }};
}

Command addKeysCommand(CLI::App& app) {
  const auto scenario = std::make_shared<std::string>();
  CLI::App* command =
      app.add_subcommand("keys", "print every key of a scenario with unit, range, default and meaning");
  command->footer("Example: fathom-sim keys reef-quick");
  command->add_option("scenario", *scenario, "its values (default: the defaults)");
  return {command, [scenario] {
            std::fputs(scenarioToml(scenario->empty() ? Scenario() : loadScenario(*scenario)).c_str(),
                       stdout);
            return kExitSuccess;
          }};
}

}  // namespace fathom::sim

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <memory>

#include "recon/topside/commands/commands.hpp"
#include "recon/topside/config/thread_limit.hpp"

namespace fathom::topside {
namespace {

struct RunOptions {
  RunSettings run;
  std::string only, items;
  bool list = false, check = false;
};

Stage stageOf(const std::string& name) {
  if (const auto stage = stageNamed(name)) return *stage;
  std::string names;
  for (const char* known : kStageNames) names += (names.empty() ? "" : ", ") + std::string(known);
  throw InputError(name, "", "no such stage; the stages are " + names);
}

// "7" or "0-15", both ends taken.
std::optional<std::pair<std::size_t, std::size_t>> itemsOf(const std::string& text) {
  if (text.empty()) return std::nullopt;
  std::size_t first = 0, last = 0;
  const char* end = text.data() + text.size();
  auto read = std::from_chars(text.data(), end, first);
  last = first;
  if (read.ec == std::errc() && read.ptr != end && *read.ptr == '-')
    read = std::from_chars(read.ptr + 1, end, last);
  if (read.ec != std::errc() || read.ptr != end || last < first)
    throw InputError("--piece", text, "give a number, or two as in 0-15");
  return std::pair(first, last + 1);
}

int check(const RunPlaces& places, const TopsideConfig& config) {
  constexpr std::size_t kNamed = 5;
  const RunCheck found = checkRun(places, config);
  std::printf("%zu pairs; %zu left and %zu right images without a partner\n", found.pairs, found.left_alone,
              found.right_alone);
  std::printf("%zu of them were looked at: %zu are unreadable\n", found.looked, found.unreadable.size());
  for (std::size_t k = 0; k < std::min(found.unreadable.size(), kNamed); ++k)
    std::printf("  %s\n", found.unreadable[k].c_str());
  if (found.seconds > 0)
    std::printf("a run takes about %s on %d thread%s\n", durationText(found.seconds).c_str(),
                threadsOf(config), threadsOf(config) == 1 ? "" : "s");
  std::printf("nothing was written\n");
  return found.unreadable.size() == found.looked ? kExitBadInput : kExitSuccess;
}

int runAll(RunOptions& o) {
  const TopsideConfig config = configOf(o.run);
  if (o.check) return check(o.run.places, config);
  if (!o.only.empty() && o.only != "assemble") {
    runOneStage(o.run.places, config, stageOf(o.only), std::nullopt);
    return kExitSuccess;
  }
  const Summary done = runTopside(o.run.places, config);
  std::printf("%zu of %zu pairs in the map (%zu unreadable): %.1f m2, %zu triangles, %zu tiles, %.1f s\n",
              done.used, done.pairs, done.unreadable, done.area, done.triangles, done.tiles, done.seconds);
  std::printf("content %s\n", done.content.hex().c_str());
  constexpr std::size_t kMost = 3;
  for (std::size_t k = 0; k < std::min(done.to_know.size(), kMost); ++k)
    std::printf("to know: %s\n", done.to_know[k].c_str());
  if (done.to_know.size() > kMost)
    std::printf("%zu more stand in %s\n", done.to_know.size() - kMost, (done.out / "report.html").c_str());
  std::printf("open it: fathom-topside view %s\n", done.out.c_str());
  return kExitSuccess;
}

}  // namespace

void addRunCommands(CommandLine& app) {
  const auto o = std::make_shared<RunOptions>();
  CommandLine& run =
      app.command("run", "from a recorded dive to a model that people explore",
                  "Example: fathom-topside run missions/reef-grid --jobs 2", [o] { return runAll(*o); });
  addRunSettings(run, o->run);
  run.add_option("--out", o->run.places.out, "folder for the results (MISSION/topside)");
  run.add_flag("--check", o->check, "say what would be refused and how long it takes, and write nothing");
  run.add_flag_callback(
      "--print-config",
      [o] {
        std::fputs(topsideToml(configOf(o->run)).c_str(), stdout);
        throw CLI::Success();
      },
      "show every key of the configuration with value, unit, range, default and meaning, as a file, and end");
  run.add_option("--only", o->only, "one stage, from those before it, into the work folder");
  CommandLine& stage =
      app.command("stage", "one stage of a run, or some of its items",
                  "Example: fathom-topside stage piece missions/reef-grid --piece 0-15", [o] {
                    runOneStage(o->run.places, configOf(o->run), stageOf(o->only), itemsOf(o->items));
                    return kExitSuccess;
                  });
  stage.add_option("stage", o->only, "survey, lighting, prepare, localise, plan, piece or level")->required();
  addRunSettings(stage, o->run);
  stage.add_option("--piece", o->items, "of prepare and piece: a number from 0, or two as in 0-15");
  CommandLine& plan = app.command("plan", "how many items the stages of a run have",
                                  "Example: fathom-topside plan missions/reef-grid", [o] {
                                    std::printf("%s\n", listItems(o->run.places, configOf(o->run)).c_str());
                                    return kExitSuccess;
                                  });
  addRunSettings(plan, o->run);
  plan.add_flag("--list", o->list, "as JSON, and nothing else (the default)");
}

}  // namespace fathom::topside

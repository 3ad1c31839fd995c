// fathom-onboard: the vehicle's program. Maps while it dives, or replays what was recorded.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/version.hpp"
#include "realtime/onboard/live/live_run.hpp"
#include "realtime/onboard/mapper/mapper_program.hpp"
#include "realtime/onboard/replay_command.hpp"

int main(int argc, char** argv) {
  using namespace fathom;

  CLI::App app{"fathom-onboard: maps the seafloor while the vehicle is under water"};
  app.footer(
      "Examples: fathom-onboard --live dives/today --config onboard.toml\n"
      "          fathom-onboard --replay missions/reef-grid --modem udp:127.0.0.1:14700 --speed 10");
  std::string folder, mission, config, timeline;
  std::filesystem::path end;
  onboard::LiveOptions live;
  onboard::MapperOptions mapper;
  onboard::ReplayCommand replay;
  CLI::Option* live_option = app.add_option(
      "--live", folder, "Dive now: folder with mission.toml and stereo.calib; is recorded into");
  CLI::Option* replay_option =
      app.add_option("--replay", mission, "Mission folder to feed to the onboard cores")
          ->excludes(live_option);
  app.add_option("--config", config,
                 "Configuration (TOML), with the devices of --live; default: built-in values");
  app.add_flag("--soft", live.soft,
               "Arm without what real time needs and the machine refuses; every status says so");
  app.add_option("--end", end, "End the dive of the program that dives in this folder, and wait for it")
      ->excludes(live_option)
      ->excludes(replay_option);
  app.add_option("--mapper", mapper.folder, "")->group("");  // what --live starts
  app.add_flag("--print-budget", live.print_budget, "Show the memory of every pool and end");
  app.add_option("--for", live.for_s, "End the dive after so many seconds; default: at SIGINT or --end")
      ->check(CLI::Range(0.0, 1e6))
      ->needs(live_option);
  app.add_option("--timeline", timeline,
                 "Write one second of every tier's stages, with a pair in it, for Perfetto (JSON)")
      ->needs(live_option);
  replay.addOptions(app, replay_option);
  app.set_version_flag("--version", versionLine("fathom-onboard"));
  if (const auto code = parseCommandLine("fathom-onboard", app, argc, argv)) return *code;
  if (!folder.empty() || !mapper.folder.empty()) (void)rt::HeapReserve::takeOverAllocator();
  return runTool("fathom-onboard", [&] {
    if (!end.empty()) return onboard::endDive(end);
    if (!mapper.folder.empty()) {
      if (!config.empty()) mapper.config = config;
      mapper.soft = live.soft;
      mapper.print_budget = live.print_budget;
      return onboard::runMapper(mapper);
    }
    if (folder.empty() && mission.empty())
      throw InputError("fathom-onboard", "",
                       "give --live FOLDER to dive or --replay MISSION; --help shows all");
    if (folder.empty()) return replay.run(mission, config);
    live.folder = folder;
    if (!config.empty()) live.config = config;
    if (!timeline.empty()) live.timeline = timeline;
    return onboard::runLive(live);
  });
}

// fathom-onboard: the vehicle's program. Maps while it dives, or replays what was recorded.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "firmware_if/devices/device_address.hpp"
#include "realtime/base/command_line.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/version.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/onboard/live/live_run.hpp"
#include "realtime/onboard/mapper/mapper_program.hpp"
#include "realtime/onboard/replay.hpp"

namespace fathom::onboard {
namespace {

// Options and execution of `fathom-onboard --replay MISSION`.
class ReplayCommand {
 public:
  // `replay`: the option --replay, which the others need.
  void addOptions(CLI::App& app, CLI::Option* replay);
  // Returns the exit code; throws InputError.
  int run(const std::string& mission, const std::string& config);

 private:
  std::string out_, modem_, downlink_;
  ReplayOptions options_;
};

void ReplayCommand::addOptions(CLI::App& app, CLI::Option* replay) {
  app.add_option("--out", out_, "Folder to write; default: MISSION/onboard")->needs(replay);
  app.add_option("--modem", modem_, "Send and receive frames: udp:HOST:PORT or serial:DEVICE:BAUD")
      ->needs(replay);
  app.add_option("--downlink", downlink_, "Receive these frames instead: downlink.bin of an earlier run");
  app.add_option("--speed", options_.link.speed,
                 "With --modem: mission seconds a second; 0: as fast as it goes")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--drain", options_.drain_s,
                 "Continue sending after the last sample, at most so many mission seconds")
      ->check(CLI::Range(0.0, 1e6));
  app.add_flag("--no-slam", options_.no_slam, "Dead reckoning only: no visual odometry, no loop closures");
}

int ReplayCommand::run(const std::string& mission, const std::string& config) {
  options_.mission = mission;
  if (!config.empty()) options_.config = config;
  if (!out_.empty()) options_.out = out_;
  const auto port = modem_.empty() ? nullptr : io::openFramePort(modem_, "--modem " + modem_);
  if (port && !port->isOpen()) throw InputError("--modem " + modem_, "", std::string(port->reason()));
  options_.link.modem = port.get();
  if (!downlink_.empty()) options_.link.downlink = downlink_;
  const ReplaySummary summary = replay(options_);
  if (!summary.warning.empty()) std::fprintf(stderr, "warning: %s\n", summary.warning.c_str());
  std::printf("%s\n", describe(summary).c_str());
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::onboard

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

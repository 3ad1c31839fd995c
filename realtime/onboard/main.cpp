// fathom-onboard: the vehicle's program. Maps while it dives, or replays what was recorded.
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>

#include "firmware_if/devices/device_address.hpp"
#include "realtime/base/command_line.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/onboard/live/live_run.hpp"
#include "realtime/onboard/mapper/mapper_run.hpp"
#include "realtime/onboard/replay.hpp"

namespace fathom::onboard {
namespace {

int replayWith(ReplayOptions& options, const std::string& modem) {
  const auto port = modem.empty() ? nullptr : io::openFramePort(modem, "--modem " + modem);
  if (port && !port->isOpen()) throw InputError("--modem " + modem, "", std::string(port->reason()));
  options.link.modem = port.get();
  const ReplaySummary summary = replay(options);
  if (!summary.warning.empty()) std::fprintf(stderr, "warning: %s\n", summary.warning.c_str());
  std::printf("%s\n", describe(summary).c_str());
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::onboard

int main(int argc, char** argv) {
  using namespace fathom;

  std::optional<std::filesystem::path> config;
  std::filesystem::path end;
  std::string modem;
  bool print_config = false;
  onboard::LiveOptions live;
  onboard::MapperOptions mapper;
  onboard::ReplayOptions replay;
  CommandLine app(
      "fathom-onboard: maps the seafloor while the vehicle is under water",
      "Examples: fathom-onboard --live dives/today --config onboard.toml\n"
      "          fathom-onboard --replay missions/reef-grid --modem udp:127.0.0.1:14700 --speed 10",
      [&] {
        if (!live.folder.empty() || !mapper.folder.empty()) (void)rt::HeapReserve::takeOverAllocator();
        if (!end.empty()) return onboard::endDive(end);
        if (print_config) {
          const std::filesystem::path folder = live.folder.empty() ? replay.mission : live.folder;
          const io::MissionConfig mission =
              folder.empty() ? io::MissionConfig{} : io::readMissionConfig(folder);
          std::fputs(onboard::onboardToml(onboard::readOnboardConfig(config, mission), mission).c_str(),
                     stdout);
          return int{kExitSuccess};
        }
        live.config = mapper.config = replay.config = config;
        mapper.soft = live.soft;
        mapper.print_budget = live.print_budget;
        if (!mapper.folder.empty()) return onboard::runMapper(mapper);
        if (!live.folder.empty()) return onboard::runLive(live);
        if (!replay.mission.empty()) return onboard::replayWith(replay, modem);
        throw InputError("fathom-onboard", "",
                         "give --live FOLDER to dive or --replay MISSION; --help shows all");
      });
  CLI::Option* live_option = app.add_option(
      "--live", live.folder, "Dive now: folder with mission.toml and stereo.calib; is recorded into");
  CLI::Option* replay_option =
      app.add_option("--replay", replay.mission, "Mission folder to feed to the onboard cores")
          ->excludes(live_option);
  app.add_option("--config", config,
                 "Configuration (TOML), with the devices of --live; default: built-in values");
  app.add_flag(
      "--print-config", print_config,
      "Show every key of the configuration with value, unit, range, default and meaning, as a file, and "
      "end");
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
  app.add_option("--timeline", live.timeline,
                 "Write one second of every tier's stages, with a pair in it, for Perfetto (JSON)")
      ->needs(live_option);
  app.add_option("--out", replay.out, "Folder to write; default: MISSION/onboard")->needs(replay_option);
  app.add_option("--modem", modem, "Send and receive frames: udp:HOST:PORT or serial:DEVICE:BAUD")
      ->needs(replay_option);
  app.add_option("--downlink", replay.link.downlink,
                 "Receive these frames instead: downlink.bin of an earlier run");
  app.add_option("--speed", replay.link.speed,
                 "With --modem: mission seconds a second; 0: as fast as it goes")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--drain", replay.drain_s,
                 "Continue sending after the last sample, at most so many mission seconds")
      ->check(CLI::Range(0.0, 1e6));
  app.add_flag("--no-slam", replay.no_slam, "Dead reckoning only: no visual odometry, no loop closures");
  return app.run("fathom-onboard", argc, argv, versionLine("fathom-onboard"));
}

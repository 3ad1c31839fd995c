#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/modem_ports.hpp"
#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/onboard/replay.hpp"
#include "sim/link/simulated_ship.hpp"

namespace {

// "udp:HOST:PORT" or "serial:DEVICE:BAUD".
std::unique_ptr<fathom::FramePort> openModem(const std::string& spec) {
  const std::size_t first = spec.find(':'), last = spec.rfind(':');
  const auto refuse = [&](const std::string& mend) -> std::unique_ptr<fathom::FramePort> {
    throw fathom::InputError("--modem " + spec, "", mend);
  };
  if (first == std::string::npos || last == first) return refuse("give udp:HOST:PORT or serial:DEVICE:BAUD");
  const std::string kind = spec.substr(0, first), name = spec.substr(first + 1, last - first - 1);
  int number = 0;
  try {
    number = std::stoi(spec.substr(last + 1));
  } catch (const std::exception&) {
    return refuse("the part after the last colon must be a number");
  }
  if (kind == "serial") return std::make_unique<fathom::io::SerialFramePort>(name, number);
  if (kind != "udp") return refuse("unknown kind of modem; give udp: or serial:");
  if (number < 1 || number > 65535) return refuse("the UDP port must be 1 to 65535");
  return std::make_unique<fathom::io::UdpFramePort>("0.0.0.0", 0, name, static_cast<std::uint16_t>(number));
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"fathom-onboard: maps the seafloor while the vehicle is under water"};
  app.footer("Example: fathom-onboard --replay missions/reef-grid --modem udp:127.0.0.1:14700 --speed 10");
  std::string mission, config, out, modem, downlink, heard;
  fathom::onboard::ReplayOptions options;
  fathom::sim::SimulatedShipOptions water;
  std::optional<double> water_rate;
  std::vector<double> off;
  app.add_option("--replay", mission, "Mission folder to feed to the onboard cores")->required();
  app.add_option("--config", config, "Configuration (TOML); default: built-in values");
  app.add_option("--out", out, "Folder to write; default: MISSION/onboard");
  CLI::Option* modem_option =
      app.add_option("--modem", modem, "Send and receive frames: udp:HOST:PORT or serial:DEVICE:BAUD");
  app.add_option("--downlink", downlink, "Receive these frames instead: downlink.bin of an earlier run");
  app.add_option("--speed", options.link.speed,
                 "With --modem: mission seconds a second; 0: as fast as it goes")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--drain", options.drain_s,
                 "Go on sending after the last sample, at most so many mission seconds")
      ->check(CLI::Range(0.0, 1e6));
  CLI::Option* ship_option =
      app.add_option(
             "--simulated-ship", heard,
             "Speak with a ship in simulated water; write the frames as the ship heard them into this file")
          ->excludes(modem_option);
  app.add_option("--simulated-loss", water.loss, "Share of the frames lost, either way")
      ->capture_default_str()
      ->needs(ship_option);
  app.add_option("--simulated-burst", water.mean_burst,
                 "Mean length of runs of lost frames; 0: each by itself")
      ->capture_default_str()
      ->needs(ship_option);
  app.add_option("--simulated-delay", water.delay_s, "Of sound, one way [s]")
      ->capture_default_str()
      ->needs(ship_option);
  app.add_option("--simulated-rate", water_rate, "Of either modem [bit/s]; default: link.rate_bps")
      ->needs(ship_option);
  app.add_option("--simulated-seed", water.seed, "Of every random number")
      ->capture_default_str()
      ->needs(ship_option);
  app.add_option("--simulated-off", off,
                 "The ship's computer is off from FROM to TO, in seconds of the mission")
      ->expected(2)
      ->needs(ship_option);
  app.add_flag("--no-slam", options.no_slam, "Dead reckoning only: no visual odometry, no loop closures");
  if (const auto code = fathom::parseCommandLine("fathom-onboard", app, argc, argv)) return *code;
  return fathom::runTool("fathom-onboard", [&] {
    options.mission = mission;
    if (!config.empty()) options.config = config;
    if (!out.empty()) options.out = out;
    const auto port = modem.empty() ? nullptr : openModem(modem);
    options.link.modem = port.get();
    if (!downlink.empty()) options.link.downlink = downlink;
    std::optional<fathom::sim::SimulatedShip> ship;
    if (!heard.empty()) {
      const fathom::onboard::OnboardConfig onboard = fathom::onboard::readOnboardConfig(options.config);
      water.rate_bps = water_rate.value_or(onboard.link.scheduler.rate_bps);
      water.key = onboard.downlink_key;
      if (off.size() == 2) {
        water.off_from_s = off[0];
        water.off_to_s = off[1];
      }
      ship.emplace(heard, water);
      options.link.modem = &ship->modem();
      options.link.modem_clock = [&](std::int64_t now_ns) { ship->advance(now_ns); };
    }
    const fathom::onboard::ReplaySummary s = fathom::onboard::replay(options);
    if (ship) {
      ship->finish();
      const fathom::sim::SimulatedShip::Summary w = ship->summary();
      std::printf(
          "simulated ship: heard %llu of %llu frames (%llu collided), repaired %llu; %llu of %llu answers "
          "heard\n",
          static_cast<unsigned long long>(w.heard), static_cast<unsigned long long>(w.sent),
          static_cast<unsigned long long>(w.collided), static_cast<unsigned long long>(w.repaired),
          static_cast<unsigned long long>(w.answers_heard), static_cast<unsigned long long>(w.answers));
    }
    std::printf(
        "%.0f s of mission in %.1f s: %llu of %llu pairs mapped (%llu unreadable images), %.0f m2, "
        "%.0f ms a pair; %llu frames, %llu bytes\n",
        s.mission_s, s.wall_s, static_cast<unsigned long long>(s.pairs_used),
        static_cast<unsigned long long>(s.pairs), static_cast<unsigned long long>(s.unreadable_images),
        s.mapped_area, s.pairs ? 1e3 * s.stereo_and_map_s / static_cast<double>(s.pairs) : 0.0,
        static_cast<unsigned long long>(s.frames), static_cast<unsigned long long>(s.frame_bytes));
    return static_cast<int>(fathom::kExitSuccess);
  });
}

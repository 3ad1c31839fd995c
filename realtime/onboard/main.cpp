#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "firmware_if/modem_ports.hpp"
#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/onboard/replay.hpp"

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
  std::string mission, config, out, modem;
  fathom::onboard::ReplayOptions options;
  app.add_option("--replay", mission, "Mission folder to feed to the onboard cores")->required();
  app.add_option("--config", config, "Configuration (TOML); default: built-in values");
  app.add_option("--out", out, "Folder to write; default: MISSION/onboard");
  app.add_option("--modem", modem, "Also send the frames: udp:HOST:PORT or serial:DEVICE:BAUD");
  app.add_option("--speed", options.speed, "With --modem: mission seconds a second; 0: as fast as it goes")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--drain", options.drain_s,
                 "Go on sending after the last sample, at most so many mission seconds")
      ->check(CLI::Range(0.0, 1e6));
  app.add_flag("--no-slam", options.no_slam, "Dead reckoning only: no visual odometry, no loop closures");
  if (const auto code = fathom::parseCommandLine("fathom-onboard", app, argc, argv)) return *code;
  return fathom::runTool("fathom-onboard", [&] {
    options.mission = mission;
    if (!config.empty()) options.config = config;
    if (!out.empty()) options.out = out;
    const auto port = modem.empty() ? nullptr : openModem(modem);
    options.modem = port.get();
    const fathom::onboard::ReplaySummary s = fathom::onboard::replay(options);
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

#include "realtime/onboard/replay_command.hpp"

#include <cstdio>
#include <memory>

#include "firmware_if/devices/device_address.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::onboard {

void ReplayCommand::addOptions(CLI::App& app, CLI::Option* replay) {
  app.add_option("--out", out_, "Folder to write; default: MISSION/onboard")->needs(replay);
  CLI::Option* modem_option =
      app.add_option("--modem", modem_, "Send and receive frames: udp:HOST:PORT or serial:DEVICE:BAUD")
          ->needs(replay);
  app.add_option("--downlink", downlink_, "Receive these frames instead: downlink.bin of an earlier run");
  app.add_option("--speed", options_.link.speed,
                 "With --modem: mission seconds a second; 0: as fast as it goes")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--drain", options_.drain_s,
                 "Go on sending after the last sample, at most so many mission seconds")
      ->check(CLI::Range(0.0, 1e6));
  CLI::Option* ship_option =
      app.add_option(
             "--simulated-ship", heard_,
             "Speak with a ship in simulated water; write the frames as the ship heard them into this file")
          ->excludes(modem_option);
  app.add_option("--simulated-loss", water_.loss, "Share of the frames lost, either way")
      ->capture_default_str()
      ->needs(ship_option);
  app.add_option("--simulated-burst", water_.mean_burst,
                 "Mean length of runs of lost frames; 0: each by itself")
      ->capture_default_str()
      ->needs(ship_option);
  app.add_option("--simulated-delay", water_.delay_s, "Of sound, one way [s]")
      ->capture_default_str()
      ->needs(ship_option);
  app.add_option("--simulated-rate", water_rate_, "Of either modem [bit/s]; default: link.rate_bps")
      ->needs(ship_option);
  app.add_option("--simulated-seed", water_.seed, "Of every random number")
      ->capture_default_str()
      ->needs(ship_option);
  app.add_option("--simulated-off", off_,
                 "The ship's computer is off from FROM to TO, in seconds of the mission")
      ->expected(2)
      ->needs(ship_option);
  app.add_flag("--no-slam", options_.no_slam, "Dead reckoning only: no visual odometry, no loop closures");
}

int ReplayCommand::run(const std::string& mission, const std::string& config) {
  options_.mission = mission;
  if (!config.empty()) options_.config = config;
  if (!out_.empty()) options_.out = out_;
  const auto port = modem_.empty() ? nullptr : io::openFramePort(modem_, "--modem " + modem_);
  options_.link.modem = port.get();
  if (!downlink_.empty()) options_.link.downlink = downlink_;
  std::optional<sim::SimulatedShip> ship;
  if (!heard_.empty()) {
    const OnboardConfig onboard = readOnboardConfig(options_.config, io::readMissionConfig(mission));
    water_.rate_bps = water_rate_.value_or(onboard.link.scheduler.rate_bps);
    water_.key = onboard.downlink_key;
    if (off_.size() == 2) {
      water_.off_from_s = off_[0];
      water_.off_to_s = off_[1];
    }
    ship.emplace(heard_, water_);
    options_.link.modem = &ship->modem();
    options_.link.modem_clock = [&](std::int64_t now_ns) { ship->advance(now_ns); };
  }
  const ReplaySummary s = replay(options_);
  if (ship) {
    ship->finish();
    const sim::SimulatedShip::Summary w = ship->summary();
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
  return kExitSuccess;
}

}  // namespace fathom::onboard

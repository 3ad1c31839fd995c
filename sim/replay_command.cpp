#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "realtime/kernel/input_error.hpp"
#include "realtime/onboard/replay.hpp"
#include "sim/commands.hpp"
#include "sim/link/simulated_ship.hpp"

namespace fathom::sim {
namespace {

struct State {
  onboard::ReplayOptions replay;
  std::filesystem::path heard;
  SimulatedShipOptions water;
  std::optional<double> rate_bps;
  std::vector<double> off;
};

int run(State& s) {
  const onboard::OnboardConfig onboard =
      onboard::readOnboardConfig(s.replay.config, io::readMissionConfig(s.replay.mission));
  s.water.rate_bps = s.rate_bps.value_or(onboard.link.scheduler.rate_bps);
  s.water.preamble_s = onboard.link.scheduler.preamble_s;
  s.water.key = onboard.link_key;
  if (s.off.size() == 2) {
    s.water.off_from_s = s.off[0];
    s.water.off_to_s = s.off[1];
  }
  SimulatedShip ship(s.heard, s.water);
  s.replay.link.modem = &ship.modem();
  s.replay.link.modem_clock = [&](std::int64_t now_ns) { ship.advance(now_ns); };
  const onboard::ReplaySummary replayed = onboard::replay(s.replay);
  ship.finish();
  const SimulatedShip::Summary w = ship.summary();
  std::printf(
      "simulated ship: heard %llu of %llu frames (%llu collided), repaired %llu; %llu of %llu answers heard\n"
      "%s\n",
      static_cast<unsigned long long>(w.heard), static_cast<unsigned long long>(w.sent),
      static_cast<unsigned long long>(w.collided), static_cast<unsigned long long>(w.repaired),
      static_cast<unsigned long long>(w.answers_heard), static_cast<unsigned long long>(w.answers),
      onboard::describe(replayed).c_str());
  return kExitSuccess;
}

}  // namespace

Command addReplayCommand(CLI::App& app) {
  const auto state = std::make_shared<State>();
  State& s = *state;
  CLI::App* command = app.add_subcommand(
      "replay", "replay a mission as fathom-onboard does, speaking with a ship through simulated water");
  command->footer("Example: fathom-sim replay missions/reef-grid --heard heard.bin --loss 0.3");
  command->add_option("mission", s.replay.mission, "mission folder")->required();
  command->add_option("--heard", s.heard, "file of the frames as the ship heard them, to write")->required();
  command->add_option("--config", s.replay.config, "onboard.toml (default: built-in values)");
  command->add_option("--out", s.replay.out, "folder to write (default: MISSION/onboard)");
  command
      ->add_option("--drain", s.replay.drain_s,
                   "go on sending after the last sample, at most so many mission seconds")
      ->check(CLI::Range(0.0, 1e6));
  command->add_flag("--no-slam", s.replay.no_slam,
                    "dead reckoning only: no visual odometry, no loop closures");
  command->add_option("--loss", s.water.loss, "share of the frames lost, either way")->capture_default_str();
  command->add_option("--burst", s.water.mean_burst, "mean length of runs of lost frames; 0: each by itself")
      ->capture_default_str();
  command->add_option("--delay", s.water.delay_s, "of sound, one way [s]")->capture_default_str();
  command->add_option("--rate", s.rate_bps, "of either modem [bit/s] (default: link.rate_bps)");
  command->add_option("--seed", s.water.seed, "of every random number")->capture_default_str();
  command->add_option("--off", s.off, "the ship's computer is off FROM TO, in seconds of the mission")
      ->expected(2);
  return {command, [state] { return run(*state); }};
}

}  // namespace fathom::sim

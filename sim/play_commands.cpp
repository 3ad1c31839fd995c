#include <atomic>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/install_prefix.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/onboard/replay.hpp"
#include "sim/commands.hpp"
#include "sim/hil/gige/simulated_gige_camera.hpp"
#include "sim/hil/hil_compare.hpp"
#include "sim/hil/hil_run.hpp"
#include "sim/link/channel.hpp"
#include "sim/link/simulated_ship.hpp"

namespace fathom::sim {

void addHilCommand(CommandLine& app) {
  const auto options = std::make_shared<HilOptions>();
  HilOptions& o = *options;
  // Lossless and fast water by default, so that a run can be compared with the direct replay.
  o.water.loss = o.water.duplicate = o.water.reorder = o.water.corrupt = 0;
  o.water.delay_s = 0.5;
  o.water.rate_bps = 2400;
  o.water.frame_bytes = 64;  // a fix and an acknowledgement in one
  CommandLine& command = app.command(
      "hil", "play a mission to fathom-onboard through real interfaces, in real time",
      "Example: fathom-sim hil missions/reef-quick --out run", [options] { return runHil(*options); });
  command.add_option("mission", o.mission, "mission folder with pictures")->required();
  command.add_option("--out", o.out, "folder for all results")->required();
  command.add_option("--faults", o.faults, "script of faults (sim/hil/README.md)");
  command.add_option("--config", o.config, "onboard.toml without [cameras], [dvl], [can], [lcm], [modem]");
  command.shown("--rate", o.rate, "mission seconds a second", 0.05, 20.0);
  command.add_option("--from", o.from_s, "begin at this second of the mission")
      ->check(CLI::NonNegativeNumber);
  command.add_option("--seconds", o.seconds, "of the mission; 0: to its end")->check(CLI::NonNegativeNumber);
  command.shown("--laps", o.laps, "forward, backward, forward...", 1, 10000);
  command.shown("--lead", o.lead_s, "time before the mission begins, for discovery and arming [s]", 2.0,
                600.0);
  command.add_option("--onboard", o.onboard,
                     "the program under test (default: fathom-onboard beside this one)");
  command.add_option("--onboard-option", o.onboard_options, "one more option for it, repeatable")
      ->allow_extra_args(false);
  command.add_flag("--wait", o.wait, "do not start the program: print its command, and play");
  command.add_flag("--force", o.force, "replace an earlier run");
  command.add_flag("--no-compare", o.no_compare, "play only; fathom-sim hil-compare can follow");
  command.add_flag("--udp-modem", o.udp_modem, "the modem on UDP instead of a pseudo-terminal");
  command.shown("--left-ppm", o.left_ppm, "drift of the left camera's clock", -500.0, 500.0);
  command.shown("--right-ppm", o.right_ppm, "drift of the right camera's clock", -500.0, 500.0);
  command.shown("--loss", o.water.loss, "share of the modem's frames lost", 0.0, 1.0);
  command.shown("--delay", o.water.delay_s, "travel time of sound in one direction [s]", 0.0, 30.0);
  command.shown("--link-rate", o.water.rate_bps, "of either modem [bit/s]", 80.0, 5400.0);
}

void addHilCompareCommand(CommandLine& app) {
  const auto options = std::make_shared<HilComparison>();
  CommandLine& command =
      app.command("hil-compare", "compare a run of hil with its replays and its injected faults",
                  "Example: fathom-sim hil-compare run", [options] {
                    if (options->onboard.empty()) options->onboard = installPrefix() / "bin/fathom-onboard";
                    return compareHil(*options) ? kExitSuccess : kExitFailedWork;
                  });
  command.add_option("run", options->run, "folder of the run")->required();
  command.add_option("mission", options->mission, "mission folder that was played")->required();
  command.add_option("--onboard", options->onboard, "fathom-onboard (default: beside this program)");
}

namespace {

std::atomic<bool> stop_asked{false};

}  // namespace

void addCameraCommand(CommandLine& app) {
  struct State {
    std::filesystem::path mission, schedule, faults;
    std::string side = "left";
    std::optional<std::int64_t> start, mission_start;
    GigeCameraOptions camera;
  };
  const auto state = std::make_shared<State>();
  GigeCameraOptions& o = state->camera;
  CommandLine& command = app.command(
      "camera", "serve a simulated GigE Vision camera that plays the images of a mission",
      "Example: fathom-sim camera --mission missions/reef-quick --side left --serial SIM-L --interface "
      "127.0.0.1",
      [state] {
        GigeCameraOptions& camera = state->camera;
        const io::MissionConfig mission = io::readMissionConfig(state->mission);
        const CameraSide side = state->side == "left" ? CameraSide::kLeft : CameraSide::kRight;
        camera.images = io::MissionPaths(state->mission).images();
        camera.format =
            side == CameraSide::kLeft ? mission.cameras.left_format : mission.cameras.right_format;
        camera.bits = mission.cameras.bits;
        constexpr std::int64_t kSoonNs = kSecond_ns;
        camera.start_utc_ns = state->start.value_or(rt::RealClock().utcNs() + kSoonNs);
        FaultScript script;
        if (!state->faults.empty()) script = readFaultScript(state->faults);
        const GigeSchedule schedule = withFaults(
            state->schedule.empty()
                ? missionExposures(state->mission, side, state->mission_start.value_or(mission.start_utc_ns))
                : listedExposures(state->schedule),
            script, side);
        std::signal(SIGINT, [](int) { stop_asked.store(true); });
        std::signal(SIGTERM, [](int) { stop_asked.store(true); });
        serveGigeCamera(camera, schedule, stop_asked, [&] {
          std::printf("ready %s %s\n", camera.interface.c_str(), camera.serial.c_str());
          std::fflush(stdout);
        });
        return 0;
      });
  command.add_option("--mission", state->mission, "mission folder with img/")->required();
  command.add_option("--side", state->side, "images of this side are played")
      ->required()
      ->check(CLI::IsMember({"left", "right"}));
  command.add_option("--serial", o.serial, "serial number, up to 15 characters")->required();
  command.shown("--interface", o.interface, "IP address to serve on; one camera for each address");
  command.add_option("--start", state->start,
                     "system's UTC at which mission second 0 is played [ns] (default: a second from now)");
  command.add_option("--mission-start", state->mission_start,
                     "the log's UTC that is mission second 0 [ns] (default: start_time of mission.toml)");
  command.add_option("--schedule", state->schedule,
                     "play lines of <mission second>,<file of img/> instead of the log's image events");
  command.shown("--rate", o.rate, "mission seconds for each second", 0.01, 1000.0);
  command.shown("--clock-ppm", o.clock_ppm, "rate error of its clock, positive: fast [ppm]", -10000.0,
                10000.0);
  command.shown("--clock-offset", o.clock_offset_s, "reading of its clock at the start [s]", 0.0, 1e9);
  command.shown("--frame-id-start", o.frame_id_start, "of the first exposure; 65535 is followed by 1", 1,
                65535);
  command.add_option("--faults", state->faults, "fault script; this camera's faults are injected");
  command.shown("--seed", o.seed, "of the choice of lost packets");
  command.add_option("--log", o.log, "CSV file: the result of each exposure");
  command.add_flag("--exit-when-done", o.exit_when_done, "end after the last exposure (default: serve on)");
}

namespace {

// Splits "HOST:PORT".
void parseTarget(const std::string& target, ChannelRelayOptions& options) {
  const std::size_t colon = target.rfind(':');
  const char* end = target.data() + target.size();
  if (colon != std::string::npos) {
    options.to_host = target.substr(0, colon);
    const auto [stop, error] = std::from_chars(target.data() + colon + 1, end, options.to_port);
    if (error == std::errc() && stop == end && !options.to_host.empty() && options.to_port != 0) return;
  }
  throw InputError("--to", target, "is not HOST:PORT with a port of 1 to 65535");
}

}  // namespace

void addChannelCommand(CommandLine& app) {
  struct State {
    ChannelRelayOptions options;
    std::string target;
    std::optional<double> down_loss, down_burst, down_rate;
  };
  const auto state = std::make_shared<State>();
  ChannelRelayOptions& o = state->options;
  CommandLine& command = app.command(
      "channel", "relay UDP frames through a simulated acoustic channel, until idle or SIGTERM",
      "Example: fathom-sim channel --listen 14700 --to 127.0.0.1:14701 --loss 0.1 --rate 300", [state] {
        parseTarget(state->target, state->options);
        ChannelConfig& down = state->options.down = state->options.channel;
        down.loss = state->down_loss.value_or(down.loss);
        down.mean_burst = state->down_burst.value_or(down.mean_burst);
        down.rate_bps = state->down_rate.value_or(down.rate_bps);
        try {
          return runChannelRelay(state->options);
        } catch (const std::invalid_argument& e) {
          throw InputError("channel", "", e.what());
        }
      });
  command.add_option("--listen", o.listen_port, "UDP port that takes the vehicle's frames")
      ->required()
      ->check(CLI::Range(1, 65535));
  command.add_option("--to", state->target, "HOST:PORT that receives the relayed frames")->required();
  command.shown("--loss", o.channel.loss, "fraction of lost frames");
  command.shown("--burst", o.channel.mean_burst,
                "mean length of runs of lost frames (Gilbert-Elliott), 0: each by itself");
  command.shown("--duplicate", o.channel.duplicate, "probability that a frame arrives twice");
  command.shown("--reorder", o.channel.reorder, "probability that later frames overtake it");
  command.shown("--corrupt", o.channel.corrupt, "probability that bytes of it are damaged");
  command.shown("--delay", o.channel.delay_s, "travel time [s]");
  command.shown("--rate", o.channel.rate_bps, "of the modem [bit/s], 0: no limit");
  command.shown("--queue", o.channel.queue_frames, "frames that wait for the modem; more are refused");
  command.add_flag("--half-duplex", o.half_duplex,
                   "a modem receives nothing while it transmits (needs a --rate)");
  command.add_option("--down-loss", state->down_loss,
                     "like --loss, from the ship to the vehicle (default: the same)");
  command.add_option("--down-burst", state->down_burst, "like --burst, from the ship to the vehicle");
  command.add_option("--down-rate", state->down_rate, "like --rate, of the ship's modem");
  command.shown("--seed", o.channel.seed, "of every random number");
  command.add_option("--idle-exit", o.idle_exit_s, "end after this long without a frame [s], 0: never")
      ->check(CLI::NonNegativeNumber);
}

namespace {

struct ReplayState {
  onboard::ReplayOptions replay;
  std::filesystem::path received_file;
  SimulatedShipOptions water;
  std::optional<double> rate_bps;
  std::vector<double> off;
};

int replayWithShip(ReplayState& s) {
  const onboard::OnboardConfig onboard =
      onboard::readOnboardConfig(s.replay.config, io::readMissionConfig(s.replay.mission));
  s.water.rate_bps = s.rate_bps.value_or(onboard.link.scheduler.rate_bps);
  s.water.preamble_s = onboard.link.scheduler.preamble_s;
  s.water.key = onboard.link_key;
  if (s.off.size() == 2) {
    s.water.off_from_s = s.off[0];
    s.water.off_to_s = s.off[1];
  }
  SimulatedShip ship(s.received_file, s.water);
  s.replay.link.modem = &ship.modem();
  s.replay.link.modem_clock = [&](std::int64_t now_ns) { ship.advance(now_ns); };
  const onboard::ReplaySummary replayed = onboard::replay(s.replay);
  ship.finish();
  const SimulatedShip::Summary w = ship.summary();
  std::printf(
      "simulated ship: received %llu of %llu frames (%llu collided), repaired %llu; %llu of %llu answers "
      "received\n"
      "%s\n",
      static_cast<unsigned long long>(w.received), static_cast<unsigned long long>(w.sent),
      static_cast<unsigned long long>(w.collided), static_cast<unsigned long long>(w.repaired),
      static_cast<unsigned long long>(w.answers_received), static_cast<unsigned long long>(w.answers),
      onboard::describe(replayed).c_str());
  return kExitSuccess;
}

}  // namespace

void addReplayCommand(CommandLine& app) {
  const auto state = std::make_shared<ReplayState>();
  ReplayState& s = *state;
  CommandLine& command = app.command(
      "replay", "replay a mission as fathom-onboard does, linked to a ship through simulated water",
      "Example: fathom-sim replay missions/reef-grid --heard heard.bin --loss 0.3",
      [state] { return replayWithShip(*state); });
  command.add_option("mission", s.replay.mission, "mission folder")->required();
  command.add_option("--heard", s.received_file, "file to write: the frames as the ship received them")
      ->required();
  command.add_option("--config", s.replay.config, "onboard.toml (default: built-in values)");
  command.add_option("--out", s.replay.out, "folder to write (default: MISSION/onboard)");
  command
      .add_option("--drain", s.replay.drain_s,
                  "continue to send after the last sample, at most this many mission seconds")
      ->check(CLI::Range(0.0, 1e6));
  command.add_flag("--no-slam", s.replay.no_slam,
                   "dead reckoning only: no visual odometry, no loop closures");
  command.shown("--loss", s.water.loss, "fraction of frames lost in each direction");
  command.shown("--burst", s.water.mean_burst, "mean length of runs of lost frames; 0: each by itself");
  command.shown("--delay", s.water.delay_s, "travel time of sound in one direction [s]");
  command.add_option("--rate", s.rate_bps, "of either modem [bit/s] (default: link.rate_bps)");
  command.shown("--seed", s.water.seed, "of every random number");
  command.add_option("--off", s.off, "the ship's computer is off FROM TO, in seconds of the mission")
      ->expected(2);
}

}  // namespace fathom::sim

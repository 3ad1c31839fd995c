#include <atomic>
#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "firmware_if/files/mission.hpp"
#include "realtime/kernel/clock.hpp"
#include "sim/commands.hpp"
#include "sim/hil/gige/gige_camera.hpp"

namespace fathom::sim {
namespace {

std::atomic<bool> stop_asked{false};

}  // namespace

Command addCameraCommand(CLI::App& app) {
  struct State {
    std::filesystem::path mission, schedule, faults;
    std::string side = "left";
    std::optional<std::int64_t> start, mission_start;
    GigeCameraOptions camera;
  };
  const auto state = std::make_shared<State>();
  GigeCameraOptions& o = state->camera;
  CLI::App* command =
      app.add_subcommand("camera", "be a GigE Vision camera that plays the images of a mission");
  command->footer(
      "Example: fathom-sim camera --mission missions/reef-quick --side left --serial SIM-L --interface "
      "127.0.0.1");
  command->add_option("--mission", state->mission, "mission folder with img/")->required();
  command->add_option("--side", state->side, "whose images")
      ->required()
      ->check(CLI::IsMember({"left", "right"}));
  command->add_option("--serial", o.serial, "serial number that it is found by, up to 15 characters")
      ->required();
  command->add_option("--interface", o.interface, "IP address to serve on; one camera an address")
      ->capture_default_str();
  command->add_option("--start", state->start,
                      "system's UTC at which mission second 0 is played [ns] (default: a second from now)");
  command->add_option("--mission-start", state->mission_start,
                      "the log's UTC that is mission second 0 [ns] (default: start_time of mission.toml)");
  command->add_option("--schedule", state->schedule,
                      "play lines of <mission second>,<file of img/> instead of the log's image events");
  command->add_option("--rate", o.rate, "mission seconds a second")
      ->capture_default_str()
      ->check(CLI::Range(0.01, 1000.0));
  command->add_option("--clock-ppm", o.clock_ppm, "that its clock is fast")
      ->capture_default_str()
      ->check(CLI::Range(-10000.0, 10000.0));
  command->add_option("--clock-offset", o.clock_offset_s, "what its clock shows when it starts [s]")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e9));
  command->add_option("--frame-id-start", o.frame_id_start, "of the first exposure; 65535 is followed by 1")
      ->capture_default_str()
      ->check(CLI::Range(1, 65535));
  command->add_option("--faults", state->faults, "script of faults; those of this camera are injected");
  command->add_option("--seed", o.seed, "of the packets that are lost")->capture_default_str();
  command->add_option("--log", o.log, "CSV file: what became of each exposure");
  command->add_flag("--exit-when-done", o.exit_when_done, "end after the last exposure (default: serve on)");
  return {
      command, [state] {
        GigeCameraOptions& camera = state->camera;
        const io::MissionConfig mission = io::readMissionConfig(state->mission);
        const CameraSide side = state->side == "left" ? CameraSide::kLeft : CameraSide::kRight;
        camera.images = io::MissionPaths(state->mission).images();
        camera.format =
            side == CameraSide::kLeft ? mission.cameras.left_format : mission.cameras.right_format;
        camera.bits = mission.cameras.bits;
        constexpr std::int64_t kSoonNs = 1'000'000'000;
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
      }};
}

}  // namespace fathom::sim

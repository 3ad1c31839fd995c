#include "realtime/onboard/live/live_run.hpp"

#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <stdexcept>

#include "firmware_if/camera/gige_camera.hpp"
#include "firmware_if/can/bus/can_source.hpp"
#include "firmware_if/can/send/vehicle_report.hpp"
#include "firmware_if/devices/device_address.hpp"
#include "firmware_if/dvl/dvl_source.hpp"
#include "firmware_if/lcm_bus/lcm_source.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/tiers/cpu_wake_limit.hpp"
#include "realtime/kernel/tiers/service_notify.hpp"
#include "realtime/onboard/live/live_system.hpp"
#include "realtime/onboard/live/status_publisher.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/colour_matrix.hpp"

namespace fathom::onboard {
namespace {

constexpr double kSupervise_s = 0.1;
constexpr double kStatusEvery_s = 10;
constexpr double kTimeline_s = 1, kTraceEvery_s = 10;
constexpr std::int64_t kPublisherRest_ns = 50'000'000;

volatile std::sig_atomic_t told_to_end = 0;

void onSignal(int) {
  told_to_end = 1;
}

// The thread's own signals, set before any thread begins so that all inherit nothing surprising.
void listenToSignals() {
  struct sigaction action = {};
  action.sa_handler = onSignal;
  ::sigaction(SIGTERM, &action, nullptr);
  ::sigaction(SIGINT, &action, nullptr);
}

void pause(double seconds) {
  const timespec time = {static_cast<time_t>(seconds),
                         static_cast<long>((seconds - static_cast<time_t>(seconds)) * 1e9)};
  ::clock_nanosleep(CLOCK_MONOTONIC, 0, &time, nullptr);
}

LiveDevices openDevices(const LiveConfig& config, const io::MissionConfig& mission,
                        const std::shared_ptr<io::LcmBus>& bus, const rt::VehicleClock& clock,
                        io::CanSource*& can) {
  const auto now = [&clock] { return clock.utcNs(); };
  const auto state = [&clock] { return rt::clockState(clock); };
  LiveDevices devices;
  if (!config.dvl.device.empty()) devices.samples.push_back(std::make_unique<io::DvlSource>(config.dvl, now));
  if (!config.can.interface.empty()) {
    auto source = std::make_unique<io::CanSource>(config.can, clock);
    can = source.get();
    devices.samples.push_back(std::move(source));
  }
  if (bus)
    devices.samples.push_back(
        std::make_unique<io::LcmSource>(config.lcm, bus, mission.vehicle_name, now, state));
  devices.left = std::make_unique<io::GigeCamera>(config.cameras.side[0], now, state);
  devices.right = std::make_unique<io::GigeCamera>(config.cameras.side[1], now, state);
  if (!config.modem.empty()) devices.modem = io::openFramePort(config.modem, "[modem] device");
  return devices;
}

// What other equipment on the CAN bus is told.
io::VehicleReport canReport(const io::PoseReport& pose, const MapState& map) {
  io::VehicleReport report;
  report.utc_ns = pose.utc_ns;
  report.latitude = pose.latitude;
  report.longitude = pose.longitude;
  report.sigma_horizontal = pose.sigma_horizontal;
  report.depth = pose.position.z();
  report.altitude = pose.altitude;
  report.map_area = map.mapped_area;
  report.pairs_mapped = map.pairs;
  report.pairs_dropped = map.status.pairs_dropped;
  report.health = map.status.health;
  if (!std::isnan(map.status.mission_progress)) report.mission_progress = map.status.mission_progress;
  return report;
}

std::string statusLine(LiveSystem& live, double since_s) {
  MapState map;
  NavState nav;
  (void)live.soft().readForSupervisor(map);
  (void)live.hard().readForSupervisor(nav);
  char text[300];
  std::snprintf(
      text, sizeof text,
      "%.0f s: %llu pairs mapped, %.0f m2, level %d, lag %.0f ms; altitude %s, DVL %.1f s ago; "
      "%llu frames sent; recorded %.1f GB, %.0f GB free",
      since_s, static_cast<unsigned long long>(map.pairs), map.mapped_area, static_cast<int>(map.level),
      static_cast<double>(map.lag_ns) * 1e-6, nav.altitude ? "known" : "unknown", nav.health.dvl_age,
      static_cast<unsigned long long>(map.link_frames),
      static_cast<double>(live.recorder().counters().bytes) * 1e-9, live.recorder().diskFreeMib() / 1024);
  return text;
}

// A second of all tiers in which a pair was mapped, the newest of its kind: at most one in ten seconds is
// taken.
class TraceTaker {
 public:
  TraceTaker(LiveSystem& live, const rt::VehicleClock& clock) : live_(live), clock_(clock) {}
  void look(double since_s) {
    MapState map;
    if (!live_.soft().readForSupervisor(map) || map.pairs == pairs_) return;
    pairs_ = map.pairs;
    if (since_s < next_s_) return;
    next_s_ = since_s + kTraceEvery_s;
    trace_ = now();
  }
  [[nodiscard]] std::string take() { return trace_.empty() ? now() : trace_; }

 private:
  [[nodiscard]] std::string now() const { return timelineOf(live_, clock_.monotonicNs(), kTimeline_s); }

  LiveSystem& live_;
  const rt::VehicleClock& clock_;
  std::uint64_t pairs_ = 0;
  double next_s_ = 0;
  std::string trace_;
};

void watchOver(LiveSystem& live, const LiveOptions& options, const rt::VehicleClock& clock,
               TraceTaker* traces) {
  const std::int64_t begin = clock.monotonicNs();
  double next_status = kStatusEvery_s;
  while (told_to_end == 0) {
    pause(kSupervise_s);
    for (const std::string& event : live.supervise())
      std::fprintf(stderr, "fathom-onboard: %s\n", event.c_str());
    if (live.watchdog().vitalAlive()) rt::ServiceNotify::alive();
    const double since_s = static_cast<double>(clock.monotonicNs() - begin) * 1e-9;
    if (traces != nullptr) traces->look(since_s);
    if (options.for_s > 0 && since_s >= options.for_s) return;
    if (since_s < next_status) continue;
    next_status += kStatusEvery_s;
    const std::string line = statusLine(live, since_s);
    rt::ServiceNotify::status(line);
    std::fprintf(stderr, "%s\n", line.c_str());
  }
}

// What a full disk cut short can be made again: the recording is apart from it.
bool writeOutput(LiveSystem& live, const std::filesystem::path& folder) {
  try {
    return live.write();
  } catch (const std::runtime_error& e) {
    std::fprintf(stderr, "fathom-onboard: %s; make it again from the recording: fathom-onboard --replay %s\n",
                 e.what(), folder.c_str());
    return false;
  }
}

}  // namespace

int runLive(const LiveOptions& options) {
  const io::MissionConfig mission = io::readMissionConfig(options.folder);
  const StereoRig rig = readStereoCalib(io::MissionPaths(options.folder).calib());
  OnboardConfig config = readOnboardConfig(options.config, mission);
  config.colours = readColours(io::MissionPaths(options.folder).calib());
  if (!config.warning.empty()) std::fprintf(stderr, "fathom-onboard: warning: %s\n", config.warning.c_str());
  if (options.soft) config.live.realtime.soft = true;
  if (!config.live.cameras.used())
    throw InputError(options.config ? options.config->string() : "no --config", "[cameras]",
                     "names no cameras; give left and right");
  // Images of another size than the calibration's are of no use.
  const std::array<const Camera*, 2> calibrated = {&rig.left, &rig.right};
  for (std::size_t i = 0; i < calibrated.size(); ++i) {
    config.live.cameras.side[i].width = calibrated[i]->width;
    config.live.cameras.side[i].height = calibrated[i]->height;
  }
  if (const std::string warning = io::plannedRoomWarning(config.live.recorder, mission, rig, options.folder);
      !warning.empty())
    std::fprintf(stderr, "fathom-onboard: warning: %s\n", warning.c_str());
  (void)rt::setLibraryStackBytes(config.live.realtime.library_stack_bytes);
  listenToSignals();

  rt::VehicleClock clock(vehicleClockOffset(options.folder / "state"));
  std::shared_ptr<io::LcmBus> bus;
  io::CanSource* can = nullptr;
  if (!config.live.lcm.url.empty()) bus = std::make_shared<io::LcmBus>(config.live.lcm.url);
  LiveSystem live({options.folder, config, mission, rig}, openDevices(config.live, mission, bus, clock, can),
                  clock);
  std::unique_ptr<StatusPublisher> publisher;
  const std::size_t lane = live.addBestEffort(
      "publisher",
      [&publisher, &can] {
        publisher->step();
        if (can != nullptr && publisher->pose())
          can->publish(canReport(*publisher->pose(), publisher->map()));
      },
      kPublisherRest_ns);
  publisher = std::make_unique<StatusPublisher>(
      live, bus, mission, options.folder, StatusPublisher::Config{config.live.lcm.publish_hz, lane}, clock);
  for (const std::string& line : live.resumeSaid())
    std::fprintf(stderr, "fathom-onboard: %s\n", line.c_str());
  std::fprintf(stderr, "%s", live.budget().table(false).c_str());
  if (options.print_budget) return kExitSuccess;
  const rt::ArmingResult arming = live.arm();
  if (!arming.complete()) std::fprintf(stderr, "%s", arming.message().c_str());
  if (!arming.armed()) return kExitFailedWork;
  if (live.resumed())
    std::fprintf(stderr, "fathom-onboard: goes on with this dive after %.2f s away, from %s\n",
                 live.awaySeconds(),
                 live.resumedFrom() == 0 ? "its log alone"
                                         : ("checkpoint " + std::to_string(live.resumedFrom())).c_str());
  if (arming.complete())
    std::fprintf(stderr, "armed with SCHED_FIFO and locked memory\n");
  else
    std::fprintf(stderr, "armed in SOFT mode: without %s\n", arming.missingNames().c_str());
  std::printf("armed\n");
  std::fflush(stdout);
  rt::ServiceNotify::ready(arming.complete() ? "armed" : "armed in soft mode");

  const rt::CpuWakeLimit wake(config.live.realtime.cpu_wake_us);
  TraceTaker traces(live, clock);
  watchOver(live, options, clock, options.timeline ? &traces : nullptr);
  rt::ServiceNotify::stopping();
  const std::string trace = options.timeline ? traces.take() : "";
  live.stop();
  const bool mapped = writeOutput(live, options.folder);
  if (options.timeline) {
    writeFile(*options.timeline, trace);
  }
  std::fprintf(stderr, "%s", live.budget().table(true).c_str());
  const RunSummary s = live.run().summary();
  if (!s.warning.empty()) std::fprintf(stderr, "warning: %s\n", s.warning.c_str());
  std::printf(
      "%.0f s live: %llu of %llu pairs mapped, %.0f m2; %llu frames, %llu bytes sent, %llu received\n",
      s.mission_s, static_cast<unsigned long long>(s.pairs_used), static_cast<unsigned long long>(s.pairs),
      s.mapped_area, static_cast<unsigned long long>(s.frames),
      static_cast<unsigned long long>(s.frame_bytes), static_cast<unsigned long long>(s.frames_received));
  if (mapped) return kExitSuccess;
  std::fprintf(stderr, "fathom-onboard: no stereo pair gave a map; the recording in %s is whole\n",
               options.folder.c_str());
  return kExitFailedWork;
}

}  // namespace fathom::onboard

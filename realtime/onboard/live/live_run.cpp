#include "realtime/onboard/live/live_run.hpp"

#include <signal.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "firmware_if/devices/camera/gige_camera.hpp"
#include "firmware_if/devices/can/bus/can_source.hpp"
#include "firmware_if/devices/can/send/can_sender.hpp"
#include "firmware_if/devices/device_address.hpp"
#include "firmware_if/devices/dvl/dvl_source.hpp"
#include "firmware_if/devices/lcm/lcm_source.hpp"
#include "realtime/base/command_line.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/health/system_status.hpp"
#include "realtime/kernel/threads/arming.hpp"
#include "realtime/kernel/threads/service_notify.hpp"
#include "realtime/onboard/live/dive_lock.hpp"
#include "realtime/onboard/live/live_system.hpp"
#include "realtime/onboard/live/status_publisher.hpp"
#include "recon/geometry/colour.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kSupervise_ns = 100'000'000;
constexpr double kStatusEvery_s = 10;
constexpr double kTimeline_s = 1, kTraceEvery_s = 10;
constexpr double kLeaveWithin_s = 10;
constexpr const char* kThisProgram = "/proc/self/exe";

void say(const std::string& line) {
  std::fprintf(stderr, "fathom-onboard: %s\n", line.c_str());
}

// What a signal asks for. SIGINT and SIGUSR1 (fathom-onboard --end) end the dive; SIGTERM, as at a shutdown
// or a restart of the unit, ends the program, and the dive continues when it is started again. A second
// SIGTERM ends at once.
enum class Asked : std::sig_atomic_t { kNothing = 0, kLeave, kEnd };
volatile std::sig_atomic_t asked = 0, terms = 0;

void onSignal(int signal) {
  if (signal == SIGTERM) {
    if (terms != 0) ::_exit(kExitFailedWork);
    terms = 1;
    if (asked == 0) asked = static_cast<std::sig_atomic_t>(Asked::kLeave);
    return;
  }
  if (asked == static_cast<std::sig_atomic_t>(Asked::kEnd) && signal == SIGINT) ::_exit(kExitFailedWork);
  asked = static_cast<std::sig_atomic_t>(Asked::kEnd);
}

// The thread's own signals, set before any thread begins so that all inherit nothing surprising.
void listenToSignals() {
  struct sigaction action = {};
  action.sa_handler = onSignal;
  for (const int signal : {SIGTERM, SIGINT, SIGUSR1}) ::sigaction(signal, &action, nullptr);
  // A dive that was started by hand outlives the connection that it was started over.
  action.sa_handler = SIG_IGN;
  for (const int signal : {SIGHUP, SIGPIPE}) ::sigaction(signal, &action, nullptr);
}

// `bus` and `can`: null where there is none.
LiveDevices openDevices(const LiveConfig& config, const io::MissionConfig& mission,
                        const rt::VehicleClock& clock, std::shared_ptr<io::LcmBus>& bus,
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
  if (!config.lcm.url.empty()) {
    bus = std::make_shared<io::LcmBus>(config.lcm.url);
    devices.samples.push_back(
        std::make_unique<io::LcmSource>(config.lcm, bus, mission.vehicle_name, now, state));
  }
  devices.left = std::make_unique<io::GigeCamera>(config.cameras.side[0], now, state);
  devices.right = std::make_unique<io::GigeCamera>(config.cameras.side[1], now, state);
  if (!config.modem.empty()) devices.modem = io::openFramePort(config.modem, "[modem] device");
  return devices;
}

// Navigation for other equipment on the CAN bus.
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
  (void)live.mapper().up().readMap(map);
  (void)live.hard().readForSupervisor(nav);
  const PartState mapper = live.parts().read("mapper").state;
  char text[300];
  std::snprintf(text, sizeof text,
                "%.0f s: %llu pairs mapped, %.0f m2, level %d, lag %.0f ms%s; altitude %s, DVL %.1f s ago; "
                "%llu frames sent; recorded %.1f GB, %.0f GB free",
                since_s, static_cast<unsigned long long>(map.pairs), map.mapped_area,
                static_cast<int>(map.level), static_cast<double>(map.lag_ns) * 1e-6,
                mapper == PartState::kRunning ? "" : (std::string(", mapper ") + nameOf(mapper)).c_str(),
                nav.altitude ? "known" : "unknown", nav.health.dvl_age,
                static_cast<unsigned long long>(map.link_frames),
                static_cast<double>(live.recorder().counters().bytes) * 1e-9,
                live.recorder().diskFreeMib() / 1024);
  return text;
}

// A second of all tiers in which a pair was mapped, the newest of its kind: at most one in ten seconds is
// taken.
class TraceTaker {
 public:
  TraceTaker(LiveSystem& live, const rt::VehicleClock& clock) : live_(live), clock_(clock) {}
  void look(double since_s) {
    MapState map;
    if (!live_.mapper().up().readMap(map) || map.pairs == pairs_) return;
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

// Notes and says what a cold start has reached.
void lookAtStart(LiveSystem& live, StartTimes& start) {
  const auto reached = [](double& at, const char* what) {
    at = rt::secondsSinceProgramStart();
    char text[100];
    std::snprintf(text, sizeof text, "%s, %.1f s after the program's start", what, at);
    say(text);
  };
  NavState nav;
  if (start.navigating == 0 && live.hard().readForSupervisor(nav) && nav.pose_utc_ns != 0)
    reached(start.navigating, "navigates");
  MapState map;
  if (start.first_pair == 0 && !live.resumed() && live.mapper().up().readMap(map) && map.pairs > 0)
    reached(start.first_pair, "the first pair is mapped");
}

// Runs until an end is requested; returns which.
Asked watchOver(LiveSystem& live, const LiveOptions& options, const rt::VehicleClock& clock,
                TraceTaker* traces, StartTimes& start) {
  const std::int64_t begin = clock.monotonicNs();
  double next_status = kStatusEvery_s;
  while (asked == 0) {
    rt::restFor(kSupervise_ns);
    for (const std::string& event : live.supervise()) say(event);
    lookAtStart(live, start);
    const double since_s = static_cast<double>(clock.monotonicNs() - begin) * 1e-9;
    if (traces != nullptr) traces->look(since_s);
    if (options.for_s > 0 && since_s >= options.for_s) return Asked::kEnd;
    if (since_s < next_status) continue;
    next_status += kStatusEvery_s;
    const std::string line = statusLine(live, since_s);
    rt::ServiceNotify::status(line);
    std::fprintf(stderr, "%s\n", line.c_str());
  }
  return static_cast<Asked>(asked);
}

// Everything about the run itself, beside what the mapper wrote; where that is missing, alone.
void writeLiveJson(const LiveSystem& live, const std::filesystem::path& folder, double wall_s,
                   const StartTimes& start) {
  try {
    const std::filesystem::path onboard = io::MissionPaths(folder).onboard();
    std::filesystem::create_directories(onboard);
    writeFile(onboard / "live.json", liveJson(live, wall_s, start));
  } catch (const std::exception& e) {
    say(e.what());
  }
}

// How the run ended, for the operator; the exit status.
int conclude(LiveSystem& live, const LiveOptions& options, Asked how, double wall_s,
             const StartTimes& start) {
  const bool ends = how == Asked::kEnd;
  const LiveSystem::End end =
      ends ? live.end(live.config().live.realtime.end_within_s) : live.leave(kLeaveWithin_s);
  for (const std::string& line : end.left_out) say(line);
  if (ends) writeLiveJson(live, options.folder, wall_s, start);
  std::fprintf(stderr, "%s", live.budget().table(true).c_str());
  if (!ends) {
    say("the dive is not ended: it continues when the program is started again on " +
        options.folder.string());
    return kExitSuccess;
  }
  if (end.mapped) return kExitSuccess;
  say(end.no_map ? "no stereo pair gave a map; the recording is in " + options.folder.string()
                 : "there is no finished map; make it from the recording: fathom-onboard --replay " +
                       options.folder.string());
  return kExitFailedWork;
}

OnboardConfig readConfig(const LiveOptions& options, const io::MissionConfig& mission, const StereoRig& rig) {
  OnboardConfig config = readOnboardConfig(options.config, mission);
  config.colours = readColours(io::MissionPaths(options.folder).calib());
  if (!config.warning.empty()) say("warning: " + config.warning);
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
  return config;
}

// For --print-budget: the program makes its files in a folder of its own, so that a running dive is not
// affected.
class PlanFolder {
 public:
  explicit PlanFolder(const std::filesystem::path& mission) {
    std::string name = (std::filesystem::temp_directory_path() / "fathom-plan-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder: " + name);
    path_ = name;
    const io::MissionPaths from(mission), to(path_);
    std::filesystem::copy_file(from.root / "mission.toml", to.root / "mission.toml");
    std::filesystem::copy_file(from.calib(), to.calib());
    if (std::filesystem::exists(coloursBeside(from.calib())))
      std::filesystem::copy_file(coloursBeside(from.calib()), coloursBeside(to.calib()));
  }
  ~PlanFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  PlanFolder(const PlanFolder&) = delete;
  PlanFolder& operator=(const PlanFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

[[noreturn]] void endLost(const std::string& why) {
  say(why + "; the program ends, and continues the dive when it is started again");
  std::_Exit(kExitFailedWork);
}

int printBudget(const LiveOptions& options, OnboardConfig config, const io::MissionConfig& mission,
                const StereoRig& rig) {
  const PlanFolder folder(options.folder);
  config.live.recorder.planned_hours = 0;
  rt::VehicleClock clock(rt::VehicleClock::systemOffsetNs());
  std::shared_ptr<io::LcmBus> bus;
  io::CanSource* can = nullptr;
  LiveSystem live({folder.path(), config, mission, rig, kThisProgram, options.config},
                  openDevices(config.live, mission, clock, bus, can), clock);
  // runLive()'s own, for its stack.
  (void)live.addBestEffort(
      "publisher", [] {}, [] { return kSupervise_ns; });
  return live.printBudget();
}

}  // namespace

int runLive(const LiveOptions& options) {
  const io::MissionConfig mission = io::readMissionConfig(options.folder);
  const StereoRig rig = readStereoCalib(io::MissionPaths(options.folder).calib());
  const OnboardConfig config = readConfig(options, mission, rig);
  (void)rt::setLibraryStackBytes(config.live.realtime.library_stack_bytes);
  if (options.print_budget) return printBudget(options, config, mission, rig);
  const DiveLock lock(options.folder);
  if (const std::string warning = io::plannedRoomWarning(config.live.recorder, mission, rig, options.folder);
      !warning.empty())
    say("warning: " + warning);
  listenToSignals();

  std::int64_t behind_ns = 0;
  rt::VehicleClock clock(
      vehicleClockOffset(stateFolder(options.folder), newestArrival(options.folder), &behind_ns));
  if (behind_ns > 0)
    say("the clock is " + std::to_string(rt::seconds(behind_ns)) +
        " s behind the recording; the vehicle's time continues from its end");
  std::shared_ptr<io::LcmBus> bus;
  io::CanSource* can = nullptr;
  // It outlives the threads that it reports on, also when this function throws.
  std::unique_ptr<StatusPublisher> publisher;
  LiveSystem live({options.folder, config, mission, rig, kThisProgram, options.config,
                   rt::ServiceNotify::kept() ? endLost : std::function<void(const std::string&)>()},
                  openDevices(config.live, mission, clock, bus, can), clock);
  const std::size_t lane = live.addBestEffort(
      "publisher",
      [&publisher, &can] {
        publisher->step();
        if (can != nullptr && publisher->pose())
          can->publish(canReport(*publisher->pose(), publisher->map()));
      },
      [&publisher] { return publisher->restNs(); });
  publisher = std::make_unique<StatusPublisher>(
      live, bus, mission, options.folder, StatusPublisher::Config{config.live.lcm.publish_hz, lane}, clock);
  for (const std::string& line : live.resumeSaid()) say(line);
  const rt::ArmingResult arming = live.arm();
  std::fprintf(stderr, "%s", live.budget().table(false).c_str());
  if (!arming.complete()) std::fprintf(stderr, "%s", arming.message().c_str());
  if (!arming.armed()) return kExitFailedWork;
  if (live.resumed())
    std::fprintf(stderr, "fathom-onboard: continues this dive after %.2f s away\n", live.awaySeconds());
  if (arming.complete())
    std::fprintf(stderr, "armed with SCHED_FIFO and locked memory\n");
  else
    std::fprintf(stderr, "armed in SOFT mode: without %s\n", arming.missingNames().c_str());
  std::printf("armed\n");
  std::fflush(stdout);
  rt::ServiceNotify::ready(arming.complete() ? "armed" : "armed in soft mode");

  const rt::CpuWakeLimit wake(config.live.realtime.cpu_wake_us);
  const std::int64_t armed_ns = clock.monotonicNs();
  TraceTaker traces(live, clock);
  StartTimes start{.armed = rt::secondsSinceProgramStart()};
  const Asked how = watchOver(live, options, clock, options.timeline ? &traces : nullptr, start);
  rt::ServiceNotify::stopping();
  const std::string trace = options.timeline ? traces.take() : "";
  const int status = conclude(live, options, how, rt::seconds(clock.monotonicNs() - armed_ns), start);
  if (options.timeline) writeFile(*options.timeline, trace);
  if (!live.hangs()) return status;
  std::fflush(nullptr);
  std::_Exit(status);
}

int endDive(const std::filesystem::path& folder) {
  const auto holder = DiveLock::holder(folder);
  if (!holder) throw InputError(folder, "", "no program dives in this folder");
  if (::kill(*holder, SIGUSR1) != 0)
    throw InputError(folder, "",
                     "the program (process " + std::to_string(*holder) + ") cannot be signalled (" +
                         std::strerror(errno) + "); be its user, or root");
  std::printf("process %d ends its dive\n", static_cast<int>(*holder));
  while (DiveLock::holder(folder) == holder) rt::restFor(kSupervise_ns);
  const bool whole = std::filesystem::exists(io::MissionPaths(folder).onboard() / "report.json");
  std::printf("ended; %s\n", whole ? "onboard/ is whole" : "there is no finished map: --replay makes it");
  return whole ? kExitSuccess : kExitFailedWork;
}

}  // namespace fathom::onboard

#include "sim/hil/hil_run.hpp"

#include <pthread.h>
#include <sched.h>

#include <csignal>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/install_prefix.hpp"
#include "sim/hil/bench/child_process.hpp"
#include "sim/hil/bench/machine_faults.hpp"
#include "sim/hil/bench/program_under_test.hpp"
#include "sim/hil/hil_compare.hpp"
#include "sim/hil/hil_folder.hpp"
#include "sim/hil/players/dvl_player.hpp"
#include "sim/hil/players/lcm_player.hpp"
#include "sim/hil/players/modem_player.hpp"
#include "sim/hil/players/pseudo_terminal.hpp"

namespace fathom::sim {
namespace {

constexpr const char* kLcmUrl = "udpm://239.255.76.67:7667?ttl=0";
constexpr double kCameraStart_s = 10;  // timeout for a simulated camera to serve
constexpr double kProgramEnd_s = 120;  // timeout for the program to write its map
constexpr double kAfterMission_s = 3;  // for frames in transit
constexpr double kLastFixes_s = 60;    // timeout for the ship to send its last fixes
constexpr double kProgressEvery_s = 10;
// Size of the recording's disk beside the images: written data, and space that the program only reserves
// (slot files for tens of thousands of pairs), which takes no room in a sparse file [bytes].
constexpr std::uint64_t kWrittenBesideImages = 1ULL << 30, kReservedUnwritten = 16ULL << 30;

std::atomic<bool> interrupted{false};

void onSignal(int) {
  interrupted = true;
}

struct SideOptions {
  CameraSide side;
  const char* name;
  const char* serial;
  int first_frame_id;     // different, so that numbers never match by chance
  double clock_offset_s;  // reading of its clock at the start
};
constexpr std::array<SideOptions, 2> kSides = {{{CameraSide::kLeft, "left", "FTH-L", 100, 1234.5},
                                                {CameraSide::kRight, "right", "FTH-R", 40000, 77.25}}};

std::string programBeside(const char* name) {
  return (installPrefix() / "bin" / name).string();
}

// Gives the calling thread, which simulates a device, priority over the program under test except its hard
// tier, since real devices do not wait for the vehicle's computer. Its work takes some tens of microseconds
// at a time. Without the privilege nothing changes, and the reported lateness grows.
void takeDevicePriority() {
  constexpr int kPriority = 75;  // above fathom-onboard's device threads (70), below its hard tier (80)
  const sched_param param = {kPriority};
  (void)::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &param);
}

class Bench {
 public:
  explicit Bench(const HilOptions& options)
      : options_(options), folder_(std::filesystem::absolute(options.out)), clock_(real_clock_) {}
  ~Bench() { stopPlayers(); }
  Bench(const Bench&) = delete;
  Bench& operator=(const Bench&) = delete;

  int run() {
    if (options_.faults) script_ = readFaultScript(*options_.faults);
    makeHilFolder(folder_, options_.force);
    network_refusal_ = enterOwnNetwork();
    note(network_refusal_.empty() ? ""
                                  : "without network namespaces: " + network_refusal_ +
                                        "; cameras are on 127.0.1.1 and 127.0.1.2");
    ScheduleOptions timing;
    timing.start_utc_ns = clock_.utcNs() + static_cast<std::int64_t>(options_.lead_s * 1e9);
    timing.from_s = options_.from_s;
    timing.seconds = options_.seconds;
    timing.rate = options_.rate;
    timing.laps = options_.laps;
    timing.rest_before_s = options_.lead_s;
    timing.rest_after_s = kLastFixes_s + kAfterMission_s;
    schedule_ = makeSchedule(options_.mission, timing);
    schedule_.mission.cameras.left_serial = kSides[0].serial;
    schedule_.mission.cameras.right_serial = kSides[1].serial;
    openDisk();
    writeHilMission(folder_, schedule_);
    openDevices();
    startCameras();
    startPlayers();
    const int status = startProgram() ? play() : kExitFailedWork;
    stopPlayers();
    cameras_.clear();
    disk_.close();
    writeReport(status);
    if (status != 0 || options_.wait || options_.no_compare || interrupted) return status;
    const bool good = compareHil({folder_.root, options_.mission, onboardProgram()});
    return good ? kExitSuccess : kExitFailedWork;
  }

 private:
  void note(const std::string& text) {
    if (text.empty()) return;
    notes_.push_back(text);
    std::fprintf(stderr, "fathom-sim hil: %s\n", text.c_str());
  }
  [[nodiscard]] std::string onboardProgram() const {
    return options_.onboard.empty() ? programBeside("fathom-onboard") : options_.onboard.string();
  }
  [[nodiscard]] bool hasFault(FaultKind kind) const {
    for (const Fault& f : script_.faults)
      if (f.kind == kind) return true;
    return false;
  }

  void openDisk() {
    if (!hasFault(FaultKind::kDiskFull) || options_.wait) return;
    const auto pixels = [](const Camera& c) {
      return 2ULL * static_cast<std::uint64_t>(c.width) * static_cast<std::uint64_t>(c.height);
    };
    std::uint64_t bytes = kWrittenBesideImages;
    for (const ScheduledExposure& e : schedule_.exposures)
      bytes += pixels(e.side == CameraSide::kLeft ? schedule_.rig.left : schedule_.rig.right);
    const std::string refusal = disk_.open(folder_.mission(), bytes, kReservedUnwritten);
    if (!refusal.empty()) note("no disk of its own for the recording: " + refusal);
  }

  void openDevices() {
    dvl_line_ = std::make_unique<PseudoTerminal>(folder_.dvl());
    dvl_ = std::make_unique<DvlPlayer>(
        schedule_, script_, clock_, [this](std::span<const std::uint8_t> bytes) { dvl_line_->write(bytes); });
    if (options_.udp_modem)
      modem_ = std::make_unique<ModemPlayer>(schedule_, script_, clock_, folder_.receivedFrames(),
                                             options_.water, std::uint16_t{0});
    else
      modem_ = std::make_unique<ModemPlayer>(schedule_, script_, clock_, folder_.receivedFrames(),
                                             options_.water, folder_.modem());
    lcm_ = std::make_unique<LcmPlayer>(schedule_, script_, clock_, kLcmUrl);
    note("compass, depth, GPS, water and battery send over LCM; can_bus_off silences them");
    HilDevices devices;
    devices.left = network_refusal_.empty() ? kSides[0].serial : "127.0.1.1";
    devices.right = network_refusal_.empty() ? kSides[1].serial : "127.0.1.2";
    devices.dvl = "serial:" + folder_.dvl().string() + ":" + std::to_string(DvlPlayer::kBaud);
    devices.dvl_latency_s = dvl_->latency();
    devices.modem = options_.udp_modem ? "udp:127.0.0.1:" + std::to_string(modem_->udpPort())
                                       : "serial:" + folder_.modem().string() + ":9600";
    devices.lcm = kLcmUrl;
    writeHilConfig(folder_, schedule_, options_, devices);
  }

  void startCameras() {
    for (std::size_t i = 0; i < kSides.size(); ++i) {
      const SideOptions& s = kSides[i];
      const Cable cable(static_cast<int>(i) + 1);
      const bool own_network = network_refusal_.empty();
      ChildProcess::Options child;
      child.argv = {programBeside("fathom-sim"),
                    "camera",
                    "--mission",
                    options_.mission.string(),
                    "--side",
                    s.name,
                    "--serial",
                    s.serial,
                    "--interface",
                    own_network ? cable.farAddress() : "127.0.1." + std::to_string(i + 1),
                    "--start",
                    std::to_string(schedule_.start_utc_ns),
                    "--rate",
                    std::to_string(options_.rate),
                    "--schedule",
                    folder_.camera(s.side, "txt").string(),
                    "--clock-ppm",
                    std::to_string(i == 0 ? options_.left_ppm : options_.right_ppm),
                    "--clock-offset",
                    std::to_string(s.clock_offset_s),
                    "--frame-id-start",
                    std::to_string(s.first_frame_id),
                    "--log",
                    folder_.camera(s.side, "csv").string()};
      if (options_.faults) {
        child.argv.emplace_back("--faults");
        child.argv.push_back(options_.faults->string());
      }
      child.output = folder_.camera(s.side, "log");
      if (own_network) child.cable = cable;
      cameras_.push_back(std::make_unique<ChildProcess>(child));
    }
    for (std::size_t i = 0; i < cameras_.size(); ++i)
      if (!cameras_[i]->waitForLine("ready", kCameraStart_s, interrupted) && !interrupted)
        throw std::runtime_error("the " + std::string(kSides[i].name) + " camera does not serve; see " +
                                 folder_.camera(kSides[i].side, "log").string());
  }

  bool startProgram() {
    const double left_s = static_cast<double>(schedule_.start_utc_ns - clock_.utcNs()) * 1e-9;
    if (options_.wait) {
      std::fprintf(
          stderr,
          "the mission begins in %.0f s; start the program now:\n  nsenter -t %d -n fathom-onboard --live "
          "%s --config %s\n",
          left_s, static_cast<int>(::getpid()), folder_.mission().c_str(), folder_.config().c_str());
      return true;
    }
    stepped_ = std::make_unique<SteppedClock>(folder_.clockStep());
    ChildProcess::Options child;
    child.argv = {onboardProgram(), "--live", folder_.mission().string(), "--config",
                  folder_.config().string()};
    for (const std::string& option : options_.onboard_options) child.argv.push_back(option);
    if (hasFault(FaultKind::kClockStep)) {
      child.environment = stepped_->environment();
      if (child.environment.empty()) {
        note("no clock steps: lib/fathom/libfathom_stepped_clock.so is not installed");
        stepped_.reset();
      }
    }
    child.output = folder_.onboardLog();
    program_ = std::make_unique<ProgramUnderTest>(child, clock_);
    if (program_->waitUntilArmed(left_s, interrupted)) {
      std::fprintf(stderr, "armed, %.1f s before the mission begins\n",
                   static_cast<double>(schedule_.start_utc_ns - clock_.utcNs()) * 1e-9);
      return true;
    }
    if (!interrupted)
      note(program_->running()
               ? "the program was not armed when the mission should have begun; give a longer --lead"
               : "the program ended before it was armed; see " + folder_.onboardLog().string());
    return false;
  }

  // The devices send before the program starts, as on a vehicle.
  void startPlayers() {
    std::erase_if(schedule_.samples, [now = clock_.utcNs()](const auto& s) { return s.due_utc_ns < now; });
    players_.emplace_back([this] {
      takeDevicePriority();
      dvl_->run(players_end_);
    });
    players_.emplace_back([this] {
      takeDevicePriority();
      lcm_->run(players_end_);
    });
    players_.emplace_back([this] { modem_->run(players_end_); });
  }
  void stopPlayers() {
    players_end_ = true;
    for (std::thread& thread : players_) thread.join();
    players_.clear();
  }

  // Waits until the mission is over and the ship has sent its fixes; false when the program ended before.
  bool waitForEnd() {
    const std::int64_t rest_ns = static_cast<std::int64_t>(kAfterMission_s * 1e9);
    const std::int64_t latest_ns = schedule_.end_utc_ns + static_cast<std::int64_t>(kLastFixes_s * 1e9);
    std::int64_t end_ns = schedule_.end_utc_ns, next_ns = schedule_.start_utc_ns;
    bool drained = false;
    while (!interrupted) {
      if (program_ && !program_->running()) return false;
      const std::int64_t now_ns = clock_.utcNs();
      if (now_ns >= next_ns) {
        std::fprintf(stderr, "mission second %.0f of %.0f%s\n", schedule_.missionSeconds(now_ns),
                     schedule_.missionSeconds(schedule_.end_utc_ns),
                     now_ns > schedule_.end_utc_ns ? ": the ship sends its last fixes" : "");
        next_ns += static_cast<std::int64_t>(kProgressEvery_s * 1e9);
      }
      if (now_ns >= end_ns && !drained && (modem_->fixesSent() || now_ns >= latest_ns)) {
        drained = true;
        end_ns = now_ns + rest_ns;
      }
      if (drained && now_ns >= end_ns) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return true;
  }

  // Plays to the end, then interrupts the program; its exit status.
  int play() {
    MachineFaults machine(schedule_, script_, clock_, disk_.isOpen() ? &disk_ : nullptr, stepped_.get(),
                          program_.get());
    std::atomic<bool> over{false};
    std::thread faults([&] { machine.run(over); });
    const bool alive = waitForEnd();
    if (!alive)
      note("the program ended by itself in mission second " +
           std::to_string(static_cast<long>(schedule_.missionSeconds(clock_.utcNs()))));
    over = true;
    faults.join();
    done_ = machine.done();
    for (const std::string& text : machine.notes()) note(text);
    int status = kExitSuccess;
    if (program_) {
      outages_ = program_->outages();
      program_->signal(SIGINT);  // as an operator ends the dive
      const auto ended = program_->wait(kProgramEnd_s);
      if (!ended) note("the program did not end when interrupted");
      status = ended.value_or(kExitFailedWork);
      if (status != 0)
        note("the program ended with status " + std::to_string(status) + "; see " +
             folder_.onboardLog().string());
      program_.reset();
      if (!alive && status == kExitSuccess) status = kExitFailedWork;
    }
    return status;
  }

  void writeReport(int status) {
    const auto expected = script_.expectedCounts(schedule_.playedTimes());
    nlohmann::ordered_json report;
    report["mission"] = std::filesystem::absolute(options_.mission).string();
    report["config"] = folder_.config().string();
    report["start_utc_ns"] = schedule_.start_utc_ns;
    report["end_utc_ns"] = schedule_.end_utc_ns;
    report["mission_begin_utc_ns"] = schedule_.mission_begin_utc_ns;
    report["rate"] = schedule_.rate;
    report["laps"] = options_.laps;
    report["own_network"] = network_refusal_.empty();
    report["program_exit"] = status;
    report["interrupted"] = interrupted.load();
    report["notes"] = notes_;
    for (std::size_t i = 0; i < kFaultKinds; ++i)
      report["expected"][std::string(nameOf(static_cast<FaultKind>(i)))] = expected[i];
    for (std::size_t i = static_cast<std::size_t>(FaultKind::kDiskFull); i < kFaultKinds; ++i)
      report["injected"][std::string(nameOf(static_cast<FaultKind>(i)))] = done_[i];
    for (const ProgramUnderTest::Outage& a : outages_)
      report["away"].push_back({{"from_utc_ns", a.from_utc_ns}, {"until_utc_ns", a.until_utc_ns}});
    const DvlPlayer::Counters& d = dvl_->counters();
    report["injected"]["dvl_garbage"] = d.damaged;
    report["injected"]["dvl_silence"] = d.withheld;
    report["dvl"] = {{"ensembles", d.ensembles},
                     {"damaged", d.damaged},
                     {"withheld", d.withheld},
                     {"unread_bytes", dvl_line_->unreadBytes()},
                     {"worst_late_ms", static_cast<double>(d.worst_late_ns) * 1e-6}};
    const LcmPlayer::Counters& l = lcm_->counters();
    report["lcm"] = {{"messages", l.messages},
                     {"withheld", l.withheld},
                     {"refused", l.refused},
                     {"worst_late_ms", static_cast<double>(l.worst_late_ns) * 1e-6}};
    const ModemPlayer::Counters m = modem_->counters();
    report["modem"] = {{"from_vehicle", m.from_vehicle},
                       {"to_vehicle", m.to_vehicle},
                       {"silenced", m.silenced},
                       {"broken", m.broken},
                       {"heard", m.ship.received},
                       {"answers", m.ship.answers},
                       {"fixes", m.fixes},
                       {"fixes_said", m.ship.fixes_sent}};
    if (options_.faults) report["faults"] = std::filesystem::absolute(*options_.faults).string();
    writeFile(folder_.report(), report.dump(2) + "\n");
  }

  const HilOptions& options_;
  HilFolder folder_;
  rt::RealClock real_clock_;
  SimulatedVehicleClock clock_;
  FaultScript script_;
  MissionSchedule schedule_;
  std::string network_refusal_;  // empty: the bench has a network of its own
  std::vector<std::string> notes_;
  RecordingDisk disk_;
  std::unique_ptr<SteppedClock> stepped_;
  std::unique_ptr<PseudoTerminal> dvl_line_;
  std::unique_ptr<DvlPlayer> dvl_;
  std::unique_ptr<LcmPlayer> lcm_;
  std::unique_ptr<ModemPlayer> modem_;
  std::vector<std::unique_ptr<ChildProcess>> cameras_;
  std::unique_ptr<ProgramUnderTest> program_;
  std::vector<ProgramUnderTest::Outage> outages_;
  std::vector<std::thread> players_;
  std::atomic<bool> players_end_{false};
  std::array<std::uint64_t, kFaultKinds> done_{};
};

}  // namespace

int runHil(const HilOptions& options) {
  interrupted = false;
  struct sigaction action {};
  action.sa_handler = onSignal;
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
  return Bench(options).run();
}

}  // namespace fathom::sim

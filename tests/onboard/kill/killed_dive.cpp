#include "tests/onboard/kill/killed_dive.hpp"

#include <sys/socket.h>
#include <unistd.h>

#include <cinttypes>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fstream>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/onboard/live/live_system.hpp"
#include "realtime/onboard/mapper/mapper_tier.hpp"
#include "tests/onboard/live/played_devices.hpp"

namespace fathom::test {
namespace {

using namespace fathom::onboard;

constexpr std::int64_t kLook_ns = 10'000'000;        // until it navigates and has caught up
constexpr std::int64_t kSupervise_ns = 50'000'000;   // afterwards
constexpr std::int64_t kMemory_ns = 10'000'000'000;  // between two looks at memory

volatile std::sig_atomic_t end_requested = 0;
void onSignal(int) {
  end_requested = 1;
}

// A datagram is a frame.
class SocketPort final : public FramePort {
 public:
  bool send(std::span<const std::uint8_t> frame) noexcept override {
    return ::send(kModemSocket, frame.data(), frame.size(), MSG_DONTWAIT | MSG_NOSIGNAL) > 0;
  }
  std::size_t receive(std::span<std::uint8_t> buffer) noexcept override {
    const ssize_t size = ::recv(kModemSocket, buffer.data(), buffer.size(), MSG_DONTWAIT);
    return size > 0 ? static_cast<std::size_t>(size) : 0;
  }
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return 0; }
};

template <class... Values>
void say(const char* format, Values... values) {
  std::printf(format, values...);
  std::fflush(stdout);
  (void)::fsync(STDOUT_FILENO);  // into a file it shall outlive the machine
}

void sayMemory(LiveSystem& live, const MapState& map, std::size_t resident_at_arming) {
  MapperFigures mapper;
  if (!live.mapper().up().figures.read(mapper)) return;
  const auto kib = [](std::uint64_t now, std::uint64_t before) {
    return (static_cast<std::int64_t>(now) - static_cast<std::int64_t>(before)) / 1024;
  };
  const rt::ThreadCost cost = live.hardCost();
  const auto* loop = live.hardLoop();
  double saving_ms = 0;
  for (std::size_t i = 0; i < MapperTier::kStages; ++i)
    if (const rt::StageSummary stage = MapperTier::summaryOf(mapper, i);
        std::strcmp(stage.name, "checkpoint") == 0)
      saving_ms = static_cast<double>(stage.max_ns) * 1e-6;
  say("M %" PRIu64 " %" PRId64 " %" PRId64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64
      " %.1f\n",
      map.pairs, kib(rt::exactResidentBytes(), resident_at_arming),
      kib(mapper.resident, mapper.resident_at_arming), cost.heap_calls, cost.minor_faults + cost.major_faults,
      loop != nullptr ? loop->skipped_cycles : 0, map.pairs_shed, mapper.checkpoints.bytes / 1024, saving_ms);
}

void watchOver(LiveSystem& live, const rt::VehicleClock& clock, const DiveOrders& orders) {
  const std::size_t resident_at_arming = rt::exactResidentBytes();
  bool navigates = false, followed = false;
  MapState map;
  NavState nav;
  std::int64_t next_supervise_ns = 0, next_memory_ns = 0, said_ns = 0;
  std::uint64_t begun_with = 0;
  std::int64_t end_ns = INT64_MAX;
  while (end_requested == 0 && clock.monotonicNs() < end_ns) {
    const timespec rest = {0, static_cast<long>(said_ns == 0 ? kLook_ns : kSupervise_ns)};
    ::clock_nanosleep(CLOCK_MONOTONIC, 0, &rest, nullptr);
    if (!navigates && live.hard().readForSupervisor(nav) && nav.inputs > 0) {
      navigates = true;
      say("N %" PRId64 " %" PRId64 "\n", clock.monotonicNs(), clock.utcNs());
      if (!orders.begun.empty()) std::ofstream(orders.begun).flush();
    }
    const bool caught_up = live.mapper().up().current() == MapperPhase::kRunning;
    if (caught_up && !followed && orders.for_s > 0)
      end_ns = clock.monotonicNs() + static_cast<std::int64_t>(orders.for_s * 1e9);
    if (caught_up && !followed)
      say("B %" PRId64 " %d\n", clock.monotonicNs(), static_cast<int>(live.mapperPid()));
    followed = caught_up;
    if (const std::uint64_t with = live.mapper().up().begun_with.load(); with != begun_with && with != 0) {
      begun_with = with;
      say("C %" PRIu64 "\n", with - 1);
    }
    if (caught_up && live.mapper().up().readMap(map) && map.utc_ns > said_ns) {
      said_ns = map.utc_ns;
      say("S %" PRId64 " %" PRId64 " %" PRIu64 " %" PRIu64 " %d %" PRIu64 "\n", clock.monotonicNs(),
          map.utc_ns, map.pairs, map.keyframes, map.map_tiles, map.link_frames_arrived);
    }
    if (clock.monotonicNs() >= next_memory_ns) {
      next_memory_ns = clock.monotonicNs() + kMemory_ns;
      sayMemory(live, map, resident_at_arming);
    }
    if (clock.monotonicNs() < next_supervise_ns) continue;
    next_supervise_ns = clock.monotonicNs() + kSupervise_ns;
    for (const std::string& event : live.supervise()) say("# %s\n", event.c_str());
  }
}

}  // namespace

DivePlayback::DivePlayback(const DiveOrders& orders, const rt::VehicleClock& clock) {
  if (orders.leg_pairs == 0) {
    played_ = std::make_unique<PlayedMission>(orders.mission, clock, orders.shift_ns);
    return;
  }
  std::uint64_t damaged = 0;
  std::vector<io::OnboardInput> inputs = io::readOnboardInputs(orders.mission, damaged);
  const std::int64_t from_ns = inputs.front().arrival_utc_ns + static_cast<std::int64_t>(orders.from_s * 1e9);
  std::erase_if(inputs, [&](const io::OnboardInput& input) { return input.arrival_utc_ns < from_ns; });
  shuttle_ = std::make_unique<Shuttle>(inputs, orders.leg_pairs);
  played_ = std::make_unique<PlayedShuttle>(*shuttle_, orders.shift_ns);
  const std::int64_t now = clock.utcNs();
  std::size_t low = 0, high = 1;
  while (played_->at(high)->due_ns < now) high *= 2;
  while (low < high)
    if (const std::size_t middle = (low + high) / 2; played_->at(middle)->due_ns < now)
      low = middle + 1;
    else
      high = middle;
  played_->first = low;
}

int dive(const DiveOrders& orders) {
  struct sigaction action = {};
  action.sa_handler = onSignal;
  ::sigaction(SIGTERM, &action, nullptr);
  const io::MissionConfig mission = io::readMissionConfig(orders.folder);
  const StereoRig rig = readStereoCalib(io::MissionPaths(orders.folder).calib());
  OnboardConfig config = readOnboardConfig(orders.config, mission);
  config.live.realtime.soft = !orders.hard;
  const std::int64_t kept_ns = vehicleClockOffset(stateFolder(orders.folder), newestArrival(orders.folder));
  rt::VehicleClock clock(orders.clock.rate > 0 ? orders.clock : rt::VehicleClock(kept_ns).setting());
  const DivePlayback playback(orders, clock);
  const Playback& played = playback.get();
  PlayedOptions play;
  if (orders.leg_pairs > 0) play.scratch = orders.folder;
  LiveDevices devices = playedDevices(played, orders.mission, mission, rig, clock, play);
  devices.modem = std::make_unique<SocketPort>();
  LiveSystem live({orders.folder, config, mission, rig, onboardProgram(), orders.config}, std::move(devices),
                  clock);
  for (const std::string& line : live.resumeSaid()) say("# %s\n", line.c_str());
  if (!live.arm().armed()) return kExitFailedWork;
  if (live.resumed())
    say("R %.3f %zu\n", live.awaySeconds(), played.first);
  else
    say("F %zu\n", played.first);
  say("A %" PRId64 "\n", clock.monotonicNs());
  watchOver(live, clock, orders);
  const LiveSystem::End end = live.end(config.live.realtime.end_within_s);
  for (const std::string& line : end.left_out) say("# %s\n", line.c_str());
  return end.mapped ? kExitSuccess : kExitFailedWork;
}

}  // namespace fathom::test

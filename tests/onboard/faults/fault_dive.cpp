#include "tests/onboard/faults/fault_dive.hpp"

#include <array>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <random>
#include <thread>

#include "firmware_if/log/recording_gap.hpp"
#include "realtime/kernel/seconds.hpp"
#include "tests/onboard/live/dived_mission.hpp"

namespace fathom::test {

using namespace fathom::onboard;
namespace fs = std::filesystem;

namespace {

constexpr std::array<const char*, kMapperFaults> kMapperNames = {
    "-", "killed", "segmentation fault", "abort", "hangs 1 s", "hangs", "10 times slower"};
constexpr std::array<const char*, 4> kPaths = {"sensors.lcmlog", "img/", "onboard.tmp", "state/"};
constexpr std::array<DiskFault, 5> kDiskFaults = {DiskFault::kNoSpace, DiskFault::kReadOnly,
                                                  DiskFault::kInputOutput, DiskFault::kStall,
                                                  DiskFault::kShortWrite};
constexpr std::array<const char*, 6> kDiskNames = {"-",   "ENOSPC",     "EROFS",
                                                   "EIO", "stalls 2 s", "short write"};
constexpr int kDisk = static_cast<int>(kPaths.size() * kDiskFaults.size()), kMapper = kMapperFaults - 1;
constexpr std::int64_t kDiskFor_ms = 2000;
constexpr std::uint64_t kPairs = 30;  // of reef-quick

BadDisk::Order diskFault(int number) {
  BadDisk::Order order;
  order.path = kPaths[static_cast<std::size_t>(number) % kPaths.size()];
  order.fault = kDiskFaults[static_cast<std::size_t>(number) / kPaths.size()];
  order.for_ms = kDiskFor_ms;
  if (order.fault == DiskFault::kStall) {
    order.stall_ms = static_cast<std::uint32_t>(kDiskFor_ms);
    order.times = 1;
  }
  return order;
}

void rest(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

// On a thread of its own, beside the supervisor.
void doTo(pid_t mapper, MapperFault fault) {
  switch (fault) {
    case MapperFault::kNone:
      return;
    case MapperFault::kKill:
      ::kill(mapper, SIGKILL);
      return;
    case MapperFault::kSegmentation:
      ::kill(mapper, SIGSEGV);
      return;
    case MapperFault::kAbort:
      ::kill(mapper, SIGABRT);
      return;
    case MapperFault::kHangs:
      ::kill(mapper, SIGSTOP);
      return;
    case MapperFault::kHangsShort:
      ::kill(mapper, SIGSTOP);
      rest(1);
      ::kill(mapper, SIGCONT);
      return;
    case MapperFault::kSlow:
      for (int k = 0; k < 30; ++k) {
        ::kill(mapper, SIGSTOP);
        rest(0.09);
        ::kill(mapper, SIGCONT);
        rest(0.01);
      }
      return;
  }
}

struct Judged {
  std::string bad;
  double back_s = 0, end_s = 0, silent_s = 0;
  void require(bool good, const std::string& what) {
    if (!good) bad += (bad.empty() ? "" : "; ") + what;
  }
};

}  // namespace

std::string FaultCase::name() const {
  std::string text = std::string("mapper ") + kMapperNames[static_cast<std::size_t>(mapper)];
  if (disk.fault != DiskFault::kNone)
    text += ", " + disk.path + " " + kDiskNames[static_cast<std::size_t>(disk.fault)];
  return text;
}

int systematicCases() {
  return kMapper + kDisk + kMapper * kDisk;
}

FaultCase faultCase(unsigned seed, int number) {
  std::mt19937_64 random(seed * 1'000'003ULL + static_cast<unsigned>(number));
  FaultCase fault;
  fault.apart_s = std::uniform_real_distribution<double>(0, 1)(random);
  if (number >= systematicCases())
    number = static_cast<int>(random() % static_cast<unsigned>(systematicCases()));
  if (number < kMapper) {
    fault.mapper = static_cast<MapperFault>(number + 1);
  } else if (number < kMapper + kDisk) {
    fault.disk = diskFault(number - kMapper);
  } else {
    number -= kMapper + kDisk;
    fault.mapper = static_cast<MapperFault>(number / kDisk + 1);
    fault.disk = diskFault(number % kDisk);
  }
  return fault;
}

int faultDive(const fs::path& mission, const fs::path& out, unsigned seed, int number) {
  const FaultCase fault = faultCase(seed, number);
  const fs::path folder = out / "dive";
  BadDisk bad_disk(folder);
  // For the mapper, which this process starts.
  for (const std::string& variable : bad_disk.environment())
    ::putenv(::strdup(variable.c_str()));  // NOLINT: the environment keeps it

  Judged judged;
  DivedMission dive(mission);
  const auto live = dive.start(folder, true, "", 12);  // three seconds without a beat: it hangs
  if (!live->arm().armed()) {
    std::printf("BAD %s: not armed\n", fault.name().c_str());
    return 1;
  }
  const auto runs = [&] { return phaseOf(*live) == MapperPhase::kRunning && live->mapperPid() > 0; };
  judged.require(dive.superviseUntil(
                     *live, [&] { return mapOf(*live).pairs >= 3; }, 120),
                 "never mapped");
  std::thread spoils([&, mapper = live->mapperPid()] {
    doTo(mapper, fault.mapper);
    rest(fault.apart_s);
    if (fault.disk.fault != DiskFault::kNone) bad_disk.set(fault.disk);
  });
  const auto begin = std::chrono::steady_clock::now();
  dive.supervise(*live, DivedMission::kRate * (fault.apart_s + 1 + 1e-3 * kDiskFor_ms));
  spoils.join();
  const auto over = std::chrono::steady_clock::now();
  bad_disk.clear();
  judged.require(dive.superviseUntil(*live, runs, 240), "the mapper does not come back");
  const std::uint64_t pairs = mapOf(*live).pairs;
  judged.back_s = rt::secondsSince(over);
  const auto maps_on = [&] { return mapOf(*live).pairs > std::min(pairs, kPairs - 1); };
  judged.require(dive.leftSeconds() < 4 || dive.superviseUntil(*live, maps_on, 60), "it maps no more");
  for (std::size_t i = 0; i < live->watchdog().tiers(); ++i)
    if (std::strcmp(live->watchdog().state(i).spec.name, "navigation") == 0)
      judged.silent_s = rt::seconds(live->watchdog().state(i).longest_silent_ns) / DivedMission::kRate;
  judged.require(judged.silent_s < 1, "navigation stood still");
  const auto end_begin = std::chrono::steady_clock::now();
  const LiveSystem::End end = live->end(60 * DivedMission::kRate);
  judged.end_s = rt::secondsSince(end_begin);
  judged.require(end.mapped, "no map");
  for (const std::string& line : end.left_out) judged.require(false, line);
  const io::Recorder::Counters recorded = live->recorder().counters();
  const bool images_hit = fault.disk.path == "img/" || fault.disk.path == "sensors.lcmlog";
  judged.require(images_hit || recorded.images_dropped_disk + recorded.images_dropped_queue == 0,
                 "images were not recorded");
  judged.require(recorded.inputs_dropped == 0 || fault.disk.path == "sensors.lcmlog", "inputs were lost");
  if (end.mapped) {
    const io::RecordingGaps gaps = io::readGaps(folder);
    const std::vector<std::string> differ = replayDifferences(folder);
    std::string names;
    for (const std::string& name : differ) names += " " + name;
    judged.require(differ.empty() || gaps.images + gaps.inputs > 0, "the replay differs:" + names);
  }
  std::printf(
      "%s %s: fault %.1f s, back after %.1f s, end %.1f s, navigation silent %.2f s, %llu starts%s%s\n",
      judged.bad.empty() ? "good" : "BAD", fault.name().c_str(),
      std::chrono::duration<double>(over - begin).count(), judged.back_s, judged.end_s, judged.silent_s,
      static_cast<unsigned long long>(live->supervisor().mapperStarts()), judged.bad.empty() ? "" : "; ",
      judged.bad.c_str());
  if (!judged.bad.empty())
    for (const std::string& line : dive.said()) std::printf("    %s\n", line.c_str());
  return judged.bad.empty() ? 0 : 1;
}

}  // namespace fathom::test

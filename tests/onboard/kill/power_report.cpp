// Cuts the power of a machine on which the whole live program dives (a user-mode Linux, whose disk loses what
// was not flushed), boots it again on the same disk, and judges what the dive then is: log, images, map's
// rows, slots and saved states are all torn at once, wherever their writes were. Exit status 1 when something
// older than a second was lost, the map is less than it was, or the recording replays to something else.
#include "tests/onboard/kill/kill_report.hpp"

#include <cstdio>
#include <fstream>
#include <random>
#include <sstream>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"
#include "tests/onboard/kill/dive_check.hpp"
#include "tests/support/recording_gaps.hpp"
#include "tests/support/test_data.hpp"
#include "tests/uml/machine.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

constexpr double kBoot_s = 6;       // from the first machine's start to the mission's first input
constexpr double kMostLost_s = 1;   // before the cut
constexpr double kShown_s = 1;      // before the cut: of what was shown later the disk may not know
constexpr double kContinues_s = 4;  // for which the dive continues once its map follows
constexpr const char* kMachine = "--memory 1024 --limit 150 --disk ";

struct Options {
  fs::path mission;
  int cuts = 10;
  unsigned seed = 1;
  double from_s = 0;
};

struct Cut {
  std::vector<std::string> wrong;
  DiveLife before, after;
  double lost_s = 0;
  bool skipped = false;
};

DiveLife readLife(const fs::path& status) {
  DiveLife life;
  std::ifstream in(status);
  for (std::string line; std::getline(in, line);) life.take(line);
  return life;
}

Cut cutPower(const Options& options, double after_s, unsigned drive_seed) {
  const TemporaryFolder folder;
  const fs::path config = folder.path() / "onboard.toml", disk = folder.path() / "disk.img",
                 begun = folder.path() / "begun";
  std::ofstream(config) << "[slam]\nmax_pairs = 200\nmax_keyframes = 200\nfeatures = 200\n"
                           "[map]\nmax_tiles = 256\n[link]\nmax_squares = 64\n"
                           "[restart]\ncheckpoint_s = 1\nbuffer_mib = 16\n"
                           "[recorder]\nplanned_hours = 0.02\nimage_reserve_mib = 1\nlog_reserve_mib = 1\n"
                           "[memory]\nheap_mib = 16\nvehicle_heap_mib = 8\nbudget_mib = 2048\n";
  const rt::VehicleClock clock(rt::VehicleClock::systemOffsetNs());
  const PlayedMission played(options.mission, clock, kBoot_s - options.from_s);

  const fs::path mission = fs::absolute(options.mission);
  const auto dive = [&](const std::string& status, const std::string& more) {
    return std::string(FATHOM_BIN_DIR) + "/onboard_kill killed-dive $FATHOM_UML_DISK/dive " +
           mission.string() + " " + config.string() + " --shift-ns=" + std::to_string(played.shift_ns) +
           more + " > " + (folder.path() / status).string();
  };
  const std::string make = "mkdir $FATHOM_UML_DISK/dive && cp " + mission.string() + "/mission.toml " +
                           mission.string() + "/stereo.calib $FATHOM_UML_DISK/dive && sync && ";
  Cut cut;
  const uml::MachineRun first = uml::runMachine(
      kMachine + disk.string() + " --format 512 --volatile-cache " + std::to_string(drive_seed) +
      " --cut-after " + std::to_string(after_s) + " --since " + begun.string() + " -- bash -c '" + make +
      dive("before", " --begun=" + begun.string()) + "'");
  const std::int64_t cut_ns = clock.utcNs();
  cut.skipped = first.status == uml::kSkipped;
  if (first.status != 0) cut.wrong.push_back("the machine: " + first.output);
  if (first.status != 0) return cut;
  cut.before = readLife(folder.path() / "before");
  cut.before.ended_utc_ns = cut_ns;
  const uml::MachineRun second = uml::runMachine(
      kMachine + disk.string() + " -- bash -c '" + dive("after", " --for-s=" + std::to_string(kContinues_s)) +
      " && cp -a $FATHOM_UML_DISK/dive " + folder.path().string() + "'");
  cut.after = readLife(folder.path() / "after");
  std::istringstream mapper(second.output);
  for (std::string line; std::getline(mapper, line);) cut.after.said.push_back(line);
  if (second.status != 0) cut.wrong.push_back("the machine that continues: " + second.output);
  if (second.status != 0) return cut;

  const auto require = [&](bool good, const std::string& what) {
    if (!good) cut.wrong.push_back(what);
  };
  cut.lost_s = LoggedInputs(folder.path() / "dive", played).oldestLost(cut.before);
  require(cut.lost_s <= kMostLost_s, "more than a second is lost");
  require(cut.after.navigates_ns > 0, "the dive did not continue");
  require(!cut.after.states.empty(), "the map did not follow");
  const auto was = newestStateUntil({cut.before}, cut_ns - static_cast<std::int64_t>(kShown_s * 1e9));
  if (was && !cut.after.states.empty()) {
    DiveState now = cut.after.states.back();
    now.arrived = was->arrived;  // there is no ship
    require(holdsAllOf(now, *was), "the map is less than it was");
  }
  const test::RecordingGaps gaps = test::readGaps(folder.path() / "dive");
  if (gaps.images + gaps.inputs == 0)
    for (const std::string& name : replayDifferences(folder.path() / "dive", config, folder.path() / "again"))
      cut.wrong.push_back("the replay differs: " + name);
  return cut;
}

int report(const Options& options) {
  std::mt19937 random(options.seed);
  std::uniform_real_distribution<double> instant(1, 18);  // [s] after it navigates
  int bad = 0;
  std::printf("%3s %7s %9s %6s %9s %9s %6s\n", "", "after s", "resumed", "from", "pairs", "keyframes",
              "lost s");
  for (int i = 0; i < options.cuts; ++i) {
    const double after_s = instant(random);
    const Cut cut = cutPower(options, after_s, static_cast<unsigned>(random()));
    if (cut.skipped) {
      std::printf("%s\n", cut.wrong.front().c_str());
      return uml::kSkipped;
    }
    const auto change = [&](std::uint64_t DiveState::*what) {
      const auto& before = cut.before.states;
      const auto& after = cut.after.states;
      return (before.empty() ? "-" : std::to_string(before.back().*what)) + ">" +
             (after.empty() ? "-" : std::to_string(after.back().*what));
    };
    std::printf("%3d %7.2f %9s %6s %9s %9s %6.2f%s\n", i + 1, after_s, cut.after.resumed ? "yes" : "no",
                cut.after.from ? std::to_string(*cut.after.from).c_str() : "-",
                change(&DiveState::pairs).c_str(), change(&DiveState::keyframes).c_str(), cut.lost_s,
                cut.wrong.empty() ? "" : "  BAD");
    for (const std::string& wrong : cut.wrong) std::printf("      %s\n", wrong.c_str());
    for (const std::string& said : cut.after.said) std::printf("      it said: %s\n", said.c_str());
    std::fflush(stdout);
    bad += cut.wrong.empty() ? 0 : 1;
  }
  std::printf("%d cuts, %d bad\n", options.cuts, bad);
  return bad == 0 ? 0 : 1;
}

}  // namespace

void powerReport(CommandLine& program) {
  static Options o;
  CommandLine& command = program.command(
      "power", "Cuts the power of the machine on which the live program dives, and lets it continue", "",
      [] { return report(o); });
  command.add_option("mission", o.mission, "recorded mission whose inputs are played")->required();
  command.shown("--cuts", o.cuts, "how often", 1, 1000);
  command.shown("--seed", o.seed, "of the instants, and of what the drive loses");
  command.shown("--from-s", o.from_s, "the dive begins there in the mission [s]");
}

}  // namespace fathom::test

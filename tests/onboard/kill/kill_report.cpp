// Kills the program on a dive again and again, with SIGKILL at random instants: while it begins, while it
// catches up, about the time when a state is saved, and in between; starts it again at once, and reports how
// long it took, what was lost, and whether the recording replays to the same bytes.
//
// The program is the live one, its devices played from the mission at their real rate in the
// vehicle's time, which continues over the restarts; a ship answers. Exit status 1 when something older than
// a second was lost, a life did not navigate in 3 s or its mapper did not follow in 10 s, or the replay
// differs.
#include "tests/onboard/kill/kill_report.hpp"

#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <random>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"
#include "realtime/onboard/live/resume.hpp"
#include "tests/onboard/kill/dive_check.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMayBeLost_ns = kSecond_ns;         // before a kill
constexpr std::int64_t kShown_ns = kSecond_ns / 2;         // until what the mapper shows is what it has
constexpr double kLead_s = 1.5;                            // from the start to the mission's first input
constexpr std::int64_t kLongestWait_ns = 60 * kSecond_ns;  // for a program that does not come back
// Of its start until it navigates, and until the mapper follows. [s]
constexpr double kNavigates_s = 3, kFollows_s = 10;

struct Options {
  fs::path mission, out = fs::temp_directory_path() / ("onboard-kill-" + std::to_string(::getpid()));
  int kills = 20;
  unsigned seed = 1;
  bool small = false, hard = false;
  double from_s = 0, checkpoint_s = 3, last_s = 6;
  std::uint64_t after_pairs = 0;
  std::size_t leg_pairs = 0;
  double rate = 10;
};

// When a life shall end.
struct Kill {
  enum class When { kBeginning, kCheckpoint, kAnywhere } when = When::kAnywhere;
  double after_s = 0;  // of the start; kCheckpoint: of the moment when a state is saved
  int checkpoint = 1;  // since it was armed
};

const char* nameOf(Kill::When when) {
  switch (when) {
    case Kill::When::kBeginning:
      return "beginning";
    case Kill::When::kCheckpoint:
      return "saving";
    case Kill::When::kAnywhere:
      break;
  }
  return "diving";
}

Kill drawKill(std::mt19937_64& random) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const double what = between(0, 1);
  constexpr double kShareBeginning = 0.25, kShareCheckpoint = 0.35;
  if (what < kShareBeginning) return {Kill::When::kBeginning, between(0.02, 1.5), 0};
  if (what < kShareBeginning + kShareCheckpoint)
    return {Kill::When::kCheckpoint, between(-0.1, 0.8), between(0, 1) < 0.5 ? 1 : 2};
  return {Kill::When::kAnywhere, between(1.5, 9), 0};
}

bool isTime(const Kill& kill, double checkpoint_s, const DiveLife& life, std::int64_t mono_ns) {
  if (mono_ns - life.spawned_ns > kLongestWait_ns) return true;
  if (kill.when != Kill::When::kCheckpoint)
    return mono_ns >= life.spawned_ns + static_cast<std::int64_t>(kill.after_s * 1e9);
  return life.armed_ns > 0 &&
         mono_ns >=
             life.armed_ns + static_cast<std::int64_t>((checkpoint_s * kill.checkpoint + kill.after_s) * 1e9);
}

fs::path beginDive(const Options& options, const fs::path& dive) {
  for (const char* name : {"dive", "again"}) fs::remove_all(options.out / name);
  fs::create_directories(dive);
  for (const char* name : {"mission.toml", "stereo.calib"})
    fs::copy_file(options.mission / name, dive / name);
  fs::path config = options.out / "onboard.toml";
  std::ofstream(config) << (options.small ? "[slam]\nmax_pairs = 400\nmax_keyframes = 400\n" : "")
                        << "[restart]\ncheckpoint_s = " << options.checkpoint_s << "\n"
                        << "[recorder]\nplanned_hours = 0.2\nimage_reserve_mib = 64\n"
                        << (options.hard ? "" : "[memory]\nbudget_mib = 4096\n");
  return config;
}

double seconds(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<double>(to_ns - from_ns) * 1e-9;
}

std::string took(std::int64_t from_ns, std::int64_t to_ns) {
  if (to_ns == 0) return "-";
  char text[20];
  std::snprintf(text, sizeof text, "%.2f", seconds(from_ns, to_ns));
  return text;
}

struct Row {
  DiveLife life;
  Kill kill;
};

std::string change(std::uint64_t before, std::optional<std::uint64_t> after) {
  return std::to_string(before) + ">" + (after ? std::to_string(*after) : "-");
}

// Whether what a life must come to came in time; nothing is held against one that was killed before.
bool inTime(const DiveLife& life, std::int64_t came_ns, double most_s) {
  const double allowed_s = sanitized() ? 10 * most_s : most_s;
  return seconds(life.spawned_ns, came_ns > 0 ? came_ns : life.ended_ns) <= allowed_s;
}

// The table; whether nothing older than a second was lost, and all came back in time.
bool print(const std::vector<Row>& rows, const LoggedInputs& logged, std::int64_t first_due_ns) {
  std::printf("%3s %9s %6s %8s | %6s %6s %5s %6s %6s | %6s %9s %9s %9s %11s\n", "", "killed", "life s",
              "at s", "nav s", "all s", "from", "said s", "away s", "lost s", "pairs", "keyframes", "tiles",
              "acknowledged");
  bool good = true;
  double worst_lost = 0, worst_nav = 0, worst_all = 0;
  std::vector<DiveLife> lives;
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    const DiveLife &life = rows[i].life, &next = rows[i + 1].life;
    lives.push_back(life);
    const double lost = logged.oldestLost(life);
    const auto before = newestStateUntil(lives, life.ended_utc_ns - kMayBeLost_ns);
    const DiveState was = before.value_or(DiveState{});
    // The first it shows may be of a tenth of a second before, when it still had hours to catch up with.
    const DiveState* now = nullptr;
    for (const DiveState& state : next.states)
      if (state.mono_ns <= next.states.front().mono_ns + kShown_ns) now = &state;
    const auto after = [&](std::uint64_t DiveState::*what) {
      return now != nullptr ? std::optional<std::uint64_t>(now->*what) : std::nullopt;
    };
    const bool kept = now == nullptr || holdsAllOf(*now, was);
    // A kill takes no file's checksum away.
    const bool whole = std::none_of(next.said.begin(), next.said.end(), [](const std::string& text) {
      return text.find("damaged") != std::string::npos || text.find("cannot be used") != std::string::npos;
    });
    const bool back =
        inTime(next, next.navigates_ns, kNavigates_s) && inTime(next, next.caught_up_ns, kFollows_s);
    const bool row_good = kept && whole && back && lost <= 1;
    good = good && row_good;
    worst_lost = std::max(worst_lost, lost);
    if (next.navigates_ns > 0) worst_nav = std::max(worst_nav, seconds(next.spawned_ns, next.navigates_ns));
    if (next.caught_up_ns > 0) worst_all = std::max(worst_all, seconds(next.spawned_ns, next.caught_up_ns));
    std::printf("%3zu %9s %6.2f %8.2f | %6s %6s %5s %6.2f %6s | %6.2f %9s %9s %9s %11s%s\n", i + 1,
                nameOf(rows[i].kill.when), seconds(life.spawned_ns, life.ended_ns),
                seconds(first_due_ns, life.ended_utc_ns), took(next.spawned_ns, next.navigates_ns).c_str(),
                took(next.spawned_ns, next.caught_up_ns).c_str(),
                next.from ? std::to_string(*next.from).c_str() : "-", next.said_away_s,
                took(life.ended_ns, next.navigates_ns).c_str(), lost,
                change(was.pairs, after(&DiveState::pairs)).c_str(),
                change(was.keyframes, after(&DiveState::keyframes)).c_str(),
                change(was.tiles, after(&DiveState::tiles)).c_str(),
                change(was.arrived, after(&DiveState::arrived)).c_str(), row_good ? "" : "  BAD");
    for (const std::string& text : next.said) std::printf("      %s\n", text.c_str());
  }
  std::printf(
      "slowest: navigates after %.2f s, all there after %.2f s; oldest input lost: %.2f s before the kill\n",
      worst_nav, worst_all, worst_lost);
  return good;
}

// Plays the mission, flown forward and back, until so many pairs are mapped, at a multiple of its pace; then
// kills the program, so that it continues with that much behind it, at its own pace.
bool playLong(const Options& options, DiveOrders& orders, Ship& ship) {
  const std::int64_t utc_offset_ns = rt::VehicleClock::systemOffsetNs();
  const rt::VehicleClock fast(utc_offset_ns, options.rate);
  constexpr double kSetUp_s = 20;
  orders.clock = fast.setting();
  orders.leg_pairs = options.leg_pairs;
  orders.from_s = options.from_s;
  orders.shift_ns = fast.utcNs() + static_cast<std::int64_t>(kSetUp_s * options.rate * 1e9);
  std::uint64_t shown = 0;
  std::printf("%9s %6s %12s %12s %11s %7s %8s %10s %10s\n", "pairs", "shed", "vehicle KiB", "mapper KiB",
              "heap calls", "faults", "skipped", "state KiB", "saving ms");
  DiveProcess process(orders, ship);
  const bool runs = process.listen([&](const DiveLife& life, std::int64_t) {
    if (life.memory && life.memory->pairs >= shown) {
      shown = life.memory->pairs + options.after_pairs / 20;
      const DiveMemory& m = *life.memory;
      const auto number = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
      std::printf("%9llu %6llu %+12lld %+12lld %11llu %7llu %8llu %10llu %10.1f\n", number(m.pairs),
                  number(m.shed), static_cast<long long>(m.vehicle_kib), static_cast<long long>(m.mapper_kib),
                  number(m.heap_calls), number(m.faults), number(m.skipped), number(m.state_kib),
                  m.saving_ms);
      std::fflush(stdout);
    }
    return !life.states.empty() && life.states.back().pairs >= options.after_pairs;
  });
  (void)process.end(SIGKILL, 0);
  const std::int64_t now_ns = fast.utcNs(), machine_ns = rt::RealClock().monotonicNs();
  orders.clock = {now_ns - machine_ns, 1, machine_ns};
  for (const std::string& text : process.life().said) std::printf("      %s\n", text.c_str());
  return runs;
}

// Kills the mapper as often as the program: how long until it follows again.
bool killMappers(const Options& options, const DiveOrders& orders, Ship& ship) {
  DiveProcess process(orders, ship);
  const auto now = [] { return rt::RealClock().monotonicNs(); };
  const auto follows = [&](std::int64_t since_ns) {
    return process.listen([&](const DiveLife& life, std::int64_t mono_ns) {
      return life.follows_ns > since_ns || mono_ns - since_ns > kLongestWait_ns;
    });
  };
  double worst_s = 0;
  bool good = follows(now());
  for (int k = 0; k < options.kills && good; ++k) {
    const std::int64_t until_ns = now() + static_cast<std::int64_t>(options.last_s * 1e9);
    (void)process.listen([&](const DiveLife&, std::int64_t mono_ns) { return mono_ns > until_ns; });
    const std::int64_t killed_ns = now();
    good = process.killMapper() && follows(killed_ns) && process.life().follows_ns > killed_ns;
    const double back_s = seconds(killed_ns, process.life().follows_ns);
    worst_s = std::max(worst_s, back_s);
    std::printf("mapper killed, %2d: follows after %.2f s\n", k + 1, back_s);
    std::fflush(stdout);
  }
  (void)process.end(SIGKILL, 0);
  std::printf("mapper killed %d times: follows after %.2f s at worst%s\n", options.kills, worst_s,
              good ? "" : "  BAD");
  return good;
}

int report(const Options& options) {
  const fs::path dive_folder = options.out / "dive";
  DiveOrders orders;
  orders.folder = dive_folder;
  orders.mission = fs::absolute(options.mission);
  orders.config = beginDive(options, dive_folder);
  orders.hard = options.hard;
  std::int64_t offset_ns = onboard::vehicleClockOffset(onboard::stateFolder(dive_folder));
  const rt::VehicleClock clock(offset_ns);
  std::uint64_t damaged = 0;
  const std::int64_t first_ns = io::readOnboardInputs(orders.mission, damaged).front().arrival_utc_ns;
  std::int64_t first_due_ns = clock.utcNs() + static_cast<std::int64_t>(kLead_s * 1e9);
  orders.shift_ns = first_due_ns - first_ns - static_cast<std::int64_t>(options.from_s * 1e9);

  std::mt19937_64 random(options.seed);
  Ship ship;
  bool mappers_good = true;
  if (options.after_pairs > 0) {
    if (!playLong(options, orders, ship)) {
      std::fprintf(stderr, "the program ended by itself\n");
      return kExitFailedWork;
    }
    offset_ns = orders.clock.offset_ns;
    first_due_ns = orders.shift_ns;
    mappers_good = killMappers(options, orders, ship);
  }
  std::vector<Row> rows;
  for (int k = 0; k < options.kills; ++k) {
    const Kill kill = drawKill(random);
    DiveProcess process(orders, ship);
    const bool runs = process.listen([&](const DiveLife& life, std::int64_t now) {
      return isTime(kill, options.checkpoint_s, life, now);
    });
    (void)process.end(SIGKILL, offset_ns);
    rows.push_back({process.life(), kill});
    if (runs) continue;
    for (const std::string& text : process.life().said) std::fprintf(stderr, "%s\n", text.c_str());
    std::fprintf(stderr, "the program ended by itself after %d kills\n", k);
    return kExitFailedWork;
  }
  DiveProcess last(orders, ship);
  const bool runs = last.listen([&](const DiveLife& life, std::int64_t now) {
    return seconds(life.spawned_ns, now) > options.last_s &&
           (life.caught_up_ns > 0 || now - life.spawned_ns > kLongestWait_ns);
  });
  const int status = last.end(SIGTERM, offset_ns);
  rows.push_back({last.life(), {}});
  const DivePlayback playback(orders, clock);
  const bool good = print(rows, LoggedInputs(dive_folder, playback.get()), first_due_ns) && mappers_good;
  std::printf("ship: %llu frames, %llu restarts\n", static_cast<unsigned long long>(ship.counters().frames),
              static_cast<unsigned long long>(ship.counters().resyncs));
  if (!runs || status != kExitSuccess) {
    std::printf("the dive did not end as it should: status %d\n", status);
    return kExitFailedWork;
  }
  if (options.after_pairs > 0) return good ? kExitSuccess : kExitFailedWork;
  const auto different = replayDifferences(dive_folder, orders.config, options.out / "again");
  for (const std::string& name : different) std::printf("REPLAY DIFFERS: %s\n", name.c_str());
  if (different.empty()) std::printf("the recording replays to the same bytes\n");
  return good && different.empty() ? kExitSuccess : kExitFailedWork;
}

}  // namespace

void killReport(CommandLine& program) {
  static Options o;
  CommandLine& command =
      program.command("kill", "Kills the live program repeatedly and reports what a restart costs", "",
                      [] { return report(o); });
  command.add_option("mission", o.mission, "recorded mission whose inputs are played")->required();
  command.shown("--kills", o.kills, "how often", 1, 1000);
  command.shown("--seed", o.seed, "of the instants");
  command.shown("--from-s", o.from_s, "the dive begins there in the mission [s]");
  command.shown("--checkpoint-s", o.checkpoint_s, "between two saved states [s]", 1, 600);
  command.add_flag("--small", o.small, "pools for some minutes, not for the five hours of the defaults");
  command.add_flag("--hard", o.hard, "with the priorities, the locked memory and the budget of a dive");
  command.shown("--last-s", o.last_s, "life of the program that is not killed [s]");
  command.shown("--after-pairs", o.after_pairs,
                "first so many, flown forward and back; then the mapper is killed as often too; no replay");
  command.shown("--leg-pairs", o.leg_pairs, "of a leg, with --after-pairs", 2, 100000);
  command.shown("--rate", o.rate, "times as fast as the mission until then", 0.1, 100);
  command.add_option("--out", o.out,
                     "folder for the dive and its replay; what is there of an earlier report is removed");
}

void killedDive(CommandLine& program) {
  static DiveOrders o;
  CommandLine& command =
      program.command("killed-dive", "The program that kill starts, and kills", "", [] { return dive(o); });
  command.add_option("folder", o.folder, "of the dive")->required();
  command.add_option("mission", o.mission, "that is played")->required();
  command.add_option("config", o.config, "onboard.toml")->required();
  command.shown("--shift-ns", o.shift_ns, "added to the mission's times gives the vehicle's");
  command.add_flag("--hard", o.hard, "not in soft mode");
  command.shown("--for-s", o.for_s, "ends by itself so long after its map follows [s]");
  command.add_option("--begun", o.begun, "file that is written when it navigates");
  command.shown("--leg-pairs", o.leg_pairs, "of a leg, forward and back without end");
  command.shown("--from-s", o.from_s, "the leg begins there in the mission [s]");
  command.shown("--rate", o.clock.rate, "of the vehicle's clock");
  command.shown("--clock-offset-ns", o.clock.offset_ns, "of the vehicle's clock");
  command.shown("--clock-begin-ns", o.clock.begin_ns, "of the vehicle's clock");
}

}  // namespace fathom::test

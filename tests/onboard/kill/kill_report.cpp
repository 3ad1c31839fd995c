// Kills the program on a dive again and again, with SIGKILL at random instants: while it begins, while it
// catches up, about the time when a state is saved, and in between; starts it again at once, and tells how
// long it took, what was lost, and whether the recording replays to the same bytes.
//
// The program is the live one in soft mode, its devices played from the mission at their real rate in the
// vehicle's time, which goes on over the restarts; a ship answers. Exit status 1 when something older than a
// second was lost, or the replay differs.
#include "tests/onboard/kill/kill_report.hpp"

#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <random>

#include "firmware_if/files/mission.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/vehicle_clock.hpp"
#include "realtime/onboard/live/resume.hpp"
#include "tests/onboard/kill/dive_check.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kSecond = 1'000'000'000;         // [ns]
constexpr std::int64_t kMayBeLost_ns = kSecond;         // before a kill
constexpr double kLead_s = 1.5;                         // from the start to the mission's first input
constexpr std::int64_t kLongestWait_ns = 60 * kSecond;  // for a program that does not come back

struct Options {
  fs::path mission, out = fs::temp_directory_path() / ("onboard-kill-" + std::to_string(::getpid()));
  int kills = 20;
  unsigned seed = 1;
  bool small = false;
  double from_s = 0, checkpoint_s = 3, last_s = 6;
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
                        << "[memory]\nbudget_mib = 4096\n";
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

// The table; whether nothing older than a second was lost.
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
    const DiveState* now = next.states.empty() ? nullptr : &next.states.front();
    const auto after = [&](std::uint64_t DiveState::*what) {
      return now != nullptr ? std::optional<std::uint64_t>(now->*what) : std::nullopt;
    };
    const bool kept = now == nullptr || holdsAllOf(*now, was);
    // A kill takes no file's checksum away.
    const bool whole = std::none_of(next.said.begin(), next.said.end(), [](const std::string& text) {
      return text.find("damaged") != std::string::npos || text.find("cannot be used") != std::string::npos;
    });
    const bool row_good = kept && whole && lost <= 1;
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

int report(const Options& options) {
  const fs::path dive_folder = options.out / "dive";
  DiveOrders orders{dive_folder, fs::absolute(options.mission), beginDive(options, dive_folder), 0};
  const std::int64_t offset_ns = onboard::vehicleClockOffset(onboard::stateFolder(dive_folder));
  const rt::VehicleClock clock(offset_ns);
  std::uint64_t damaged = 0;
  const std::int64_t first_ns = io::readOnboardInputs(orders.mission, damaged).front().arrival_utc_ns;
  const std::int64_t first_due_ns = clock.utcNs() + static_cast<std::int64_t>(kLead_s * 1e9);
  orders.shift_ns = first_due_ns - first_ns - static_cast<std::int64_t>(options.from_s * 1e9);

  std::mt19937_64 random(options.seed);
  Ship ship;
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
  const bool good = print(rows, LoggedInputs(dive_folder, orders.mission, orders.shift_ns), first_due_ns);
  std::printf("ship: %llu frames, began anew %llu times\n",
              static_cast<unsigned long long>(ship.counters().frames),
              static_cast<unsigned long long>(ship.counters().resyncs));
  if (!runs || status != kExitSuccess) {
    std::printf("the dive did not end as it should: status %d\n", status);
    return kExitFailedWork;
  }
  const auto different = differencesToReplay(dive_folder, orders.config, options.out / "again");
  for (const std::string& name : different) std::printf("REPLAY DIFFERS: %s\n", name.c_str());
  if (different.empty()) std::printf("the recording replays to the same bytes\n");
  return good && different.empty() ? kExitSuccess : kExitFailedWork;
}

}  // namespace

Report killReport() {
  static Options o;
  return {"kill",
          "Kills the live program again and again and tells what a restart costs",
          {required({"mission", &o.mission, "recorded mission whose inputs are played"}),
           {"--kills", &o.kills, "how often", 1, 1000},
           {"--seed", &o.seed, "of the instants"},
           {"--from-s", &o.from_s, "the dive begins there in the mission [s]"},
           {"--checkpoint-s", &o.checkpoint_s, "between two saved states [s]", 1, 600},
           {"--small", &o.small, "pools for some minutes, not for the five hours of the defaults"},
           {"--last-s", &o.last_s, "life of the program that is not killed [s]"},
           {"--out", &o.out,
            "folder for the dive and its replay; what is there of an earlier report is removed"}},
          [] { return report(o); }};
}

Report killedDive() {
  static DiveOrders o;
  return {"killed-dive",
          "The program that kill starts, and kills",
          {required({"folder", &o.folder, "of the dive"}),
           required({"mission", &o.mission, "that is played"}),
           required({"config", &o.config, "onboard.toml"}),
           {"--shift-ns", &o.shift_ns, "added to the mission's times gives the vehicle's"}},
          [] { return dive(o); }};
}

}  // namespace fathom::test

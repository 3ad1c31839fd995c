// onboard_faults: dives with faults of every part and of the disk, one at a time and two at once, many dives
// beside one another, and judges each: navigation, recording, map, end, replay. Exit status 1 when one is
// bad.
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <map>

#include "realtime/base/command_line.hpp"
#include "tests/onboard/faults/fault_case.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

// What this machine's disk takes is not to be judged.
fs::path memoryFolder() {
  const fs::path memory = "/dev/shm";
  return ::access(memory.c_str(), W_OK) == 0 ? memory : fs::temp_directory_path();
}

struct Options {
  fs::path mission, out = memoryFolder() / ("onboard-faults-" + std::to_string(::getpid()));
  int cases = 0, first = 0, step = 1, jobs = 1, number = 0;
  unsigned seed = 1;
};

// Forked: this process has no other thread, and nothing need be linked again.
pid_t startDive(const Options& options, int number, const fs::path& out) {
  fs::remove_all(out);
  fs::create_directories(out);
  std::fflush(nullptr);
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  int status = 1;
  if (std::freopen((out / "said").c_str(), "w", stdout) != nullptr &&
      std::freopen((out / "log").c_str(), "w", stderr) != nullptr) {
    try {
      status = faultDive(options.mission, out, options.seed, number);
    } catch (const std::exception& e) {
      std::printf("BAD %s\n", e.what());
    }
  }
  std::fflush(nullptr);
  std::_Exit(status);
}

std::string lastWords(const fs::path& out) {
  std::ifstream in(out / "said");
  std::string all, line;
  while (std::getline(in, line))
    if (line.starts_with("good ") || line.starts_with("BAD ") || line.starts_with("    ")) all += line + "\n";
  return all;
}

int report(const Options& options) {
  const int cases = options.cases == 0 ? systematicCases() : options.cases;
  std::map<pid_t, int> running;
  int next = 0, bad = 0, done = 0;
  const auto place = [&](int number) { return options.out / std::to_string(number); };
  while (next < cases || !running.empty()) {
    while (next < cases && running.size() < static_cast<std::size_t>(options.jobs)) {
      const int number = options.first + next++ * options.step;
      running[startDive(options, number, place(number))] = number;
    }
    int status = 0;
    const pid_t ended = ::waitpid(-1, &status, 0);
    if (ended <= 0) break;
    const auto which = running.find(ended);
    if (which == running.end()) continue;
    const int number = which->second;
    running.erase(which);
    const bool good = WIFEXITED(status) && WEXITSTATUS(status) == 0;
    std::string words = lastWords(place(number));
    if (words.empty()) words = "BAD " + faultCase(options.seed, number).name() + ": the program died\n";
    std::printf("%3d %s", number, words.c_str());
    std::fflush(stdout);
    ++done;
    bad += good ? 0 : 1;
    if (good) fs::remove_all(place(number));
  }
  std::printf("%d dives, %d bad%s\n", done, bad, bad > 0 ? (", in " + options.out.string()).c_str() : "");
  if (bad == 0) fs::remove_all(options.out);
  return bad == 0 && done == cases ? 0 : 1;
}

}  // namespace
}  // namespace fathom::test

int main(int argc, char** argv) {
  using namespace fathom;
  test::Options o;
  CommandLine app("Dives with faults of parts and disk, judged");
  CommandLine& faults =
      app.command("faults", "Dives with every fault of parts and disk, and with two at once", "",
                  [&] { return test::report(o); });
  CommandLine& dive = app.command("dive", "One of them", "",
                                  [&] { return test::faultDive(o.mission, o.out, o.seed, o.number); });
  for (CommandLine* command : {&faults, &dive}) {
    command->add_option("mission", o.mission, "recorded mission whose inputs are played")->required();
    command->shown("--seed", o.seed, "of the times");
  }
  faults.shown("--cases", o.cases, "how many; 0: every systematic one once");
  faults.shown("--first", o.first, "number of the first");
  faults.shown("--step", o.step, "from one case to the next", 1, 1000);
  faults.shown("--jobs", o.jobs, "dives at once", 1, 64);
  faults.add_option("--out", o.out, "folder; bad dives stay there");
  dive.shown("--number", o.number, "which");
  dive.add_option("--out", o.out, "folder of the dive");
  return app.run("onboard_faults", argc, argv);
}

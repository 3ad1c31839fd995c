// link_storm: dives of the acoustic link in storms, each judged by what the ship shows after the calm. Exit
// status 1 when one is wrong.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <mutex>
#include <thread>
#include <vector>

#include "tests/monitor/storm/storm.hpp"
#include "tests/support/report_program.hpp"

namespace fathom::test {
namespace {

struct Options {
  int runs = 50, first = 1, jobs = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
};

int report(const Options& o) {
  std::atomic<int> next = 0;
  std::mutex printing;
  int bad = 0;
  std::uint64_t frames = 0;
  const auto work = [&] {
    for (int k = next++; k < o.runs; k = next++) {
      const StormResult r = storm(static_cast<unsigned>(o.first + k));
      const std::lock_guard lock(printing);
      frames += r.frames;
      bad += r.wrong.empty() ? 0 : 1;
      std::printf("%-4s %4d %s: %zu nodes, %llu frames in %.0f s\n", r.wrong.empty() ? "good" : "BAD",
                  o.first + k, r.what.c_str(), r.nodes, static_cast<unsigned long long>(r.frames), r.seconds);
      for (const std::string& what : r.wrong) std::printf("          %s\n", what.c_str());
      std::fflush(stdout);
    }
  };
  std::vector<std::thread> threads;
  for (int j = 0; j < o.jobs; ++j) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();
  std::printf("%d of %d storms good, %llu frames\n", o.runs - bad, o.runs,
              static_cast<unsigned long long>(frames));
  return bad == 0 ? 0 : 1;
}

Report stormReport() {
  static Options o;
  return {"storm",
          "The ship's map against the vehicle's after storms of the link",
          {{"--runs", &o.runs, "how many", 1, 1e6},
           {"--first", &o.first, "seed of the first"},
           {"--jobs", &o.jobs, "at once", 1, 256}},
          [] { return report(o); }};
}

}  // namespace
}  // namespace fathom::test

int main(int argc, char** argv) {
  return fathom::test::runReports("link_storm", {fathom::test::stormReport()}, argc, argv);
}

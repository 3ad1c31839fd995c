// fathom-bench: Google Benchmark programs of all modules; --benchmark_filter=stereo runs those of one.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

namespace {

constexpr int kCorners = 800;  // of stereo's headline

// The console's table, and below it, for stereo, the ratios of the fastest repetitions and the time that a
// feature costs.
class RatioReporter : public benchmark::ConsoleReporter {
 public:
  RatioReporter() : ConsoleReporter(OO_Tabular) {}
  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      if (run.run_type != Run::RT_Iteration || run.error_occurred) continue;
      const std::string name = run.benchmark_name();
      const auto best = best_.emplace(name, INFINITY).first;
      best->second = std::min(best->second, run.GetAdjustedCPUTime());
    }
  }
  void Finalize() override {
    ratio("one thread", "stereoFathom", "stereoOpenCv");
    ratio("one thread, baseline kernels", "stereoBaselineKernels", "stereoOpenCv");
    ratio("one thread, equal light", "stereoEqualLight", "stereoOpenCvEqualLight");
    for (const char* name : {"stereoFathom", "stereoOpenCv"})
      if (std::isfinite(slope(name, 200, 5000)))
        std::printf("%s: a further feature costs %.1f us from 200 to 800, %.1f us from 800 to 5000\n", name,
                    1e3 * slope(name, 200, 800), 1e3 * slope(name, 800, 5000));
    ConsoleReporter::Finalize();
  }

 private:
  [[nodiscard]] double best(const std::string& name, int features) const {
    const auto found = best_.find(name + "/" + std::to_string(features));
    return found == best_.end() ? NAN : found->second;
  }
  [[nodiscard]] double slope(const char* name, int low, int high) const {
    return (best(name, high) - best(name, low)) / (high - low);
  }
  void ratio(const char* what, const char* fathom, const char* peer) const {
    if (!std::isfinite(best(fathom, kCorners) + best(peer, kCorners))) return;
    std::printf("sparse stereo, %d corners, %s: Fathom / OpenCV time = %.2f\n", kCorners, what,
                best(fathom, kCorners) / best(peer, kCorners));
  }

  std::map<std::string, double> best_;  // CPU time [ms]
};

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  RatioReporter reporter;
  benchmark::RunSpecifiedBenchmarks(&reporter);
  return 0;
}

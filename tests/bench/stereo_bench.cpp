#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <map>
#include <string>
#include <vector>

#include "recon/stereo/kernels/kernels.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "tests/bench/opencv_stereo.hpp"
#include "tests/stereo/synthetic_scene.hpp"

namespace fathom::stereo {
namespace {

using Pixels = std::vector<cv::Point2f>;

constexpr int kFeatures = 800;    // of the headline
constexpr double kCorrect = 0.5;  // largest error of a correct match [px]

struct Pair {
  test::SyntheticScene scene;
  test::GrayImage left, right;
};

Pair makePair(const test::Exposure& right_exposure) {
  const test::Sheet floor{
      [](double x, double y) { return 2.0 + 0.2 * x + 0.05 * std::sin(9 * x) * std::cos(7 * y); }};
  Pair made{test::SyntheticScene(test::croppedRig(1360, 1024), {floor}), {}, {}};
  std::tie(made.left, made.right) = made.scene.render({1.0, 0.0, 2.0}, right_exposure);
  return made;
}

// A full-size pair of a rolling, sloping floor at 2 m; the right image as bright as the left one, or darker,
// hazier and noisier as strobes on one side make it.
const Pair& pair(bool equal_light) {
  static const Pair equal = makePair({1.0, 0.0, 2.0}), darker = makePair({0.8, 12.0, 3.0});
  return equal_light ? equal : darker;
}

std::size_t correctMatches(const Pair& p, const Pixels& left, const Pixels& right) {
  std::size_t correct = 0;
  for (std::size_t i = 0; i < left.size(); ++i) {
    Eigen::Vector3d point;
    if (!p.scene.pointAt({left[i].x, left[i].y}, point)) continue;
    const Eigen::Vector2d truth = p.scene.rightPixel(point);
    correct += std::hypot(right[i].x - truth.x(), right[i].y - truth.y()) < kCorrect ? 1 : 0;
  }
  return correct;
}

double threadMs() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

// Counters: points, correct ones, and the mean time of each stage [ms].
void runFathom(benchmark::State& state, const Kernels& kernels, const Pair& p) {
  SparseStereoConfig config;
  config.max_features = static_cast<int>(state.range(0));
  SparseStereo stereo(p.scene.rig(), config, &kernels);
  std::map<std::string, double> stages;
  double last = 0;
  stereo.setStageObserver([&](const char* stage) {
    const double now = threadMs();
    stages[stage] += now - last;
    last = now;
  });
  const StereoResult* result = nullptr;
  for (auto _ : state) {
    last = threadMs();
    result = &stereo.process(p.left.view(), p.right.view(), {});
    benchmark::DoNotOptimize(result->points.data());
  }
  Pixels left, right;
  for (const StereoPoint& q : result->points) {
    left.emplace_back(q.left.x(), q.left.y());
    right.emplace_back(q.right.x(), q.right.y());
  }
  state.counters["points"] = static_cast<double>(left.size());
  state.counters["correct"] = static_cast<double>(correctMatches(p, left, right));
  for (const auto& [stage, ms] : stages)
    state.counters[stage] = benchmark::Counter(ms, benchmark::Counter::kAvgIterations);
}

void runPeer(benchmark::State& state, const Pair& p) {
  cv::setNumThreads(0);
  const auto mat = [](const test::GrayImage& image) {
    return cv::Mat(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.pixels.data()));
  };
  OpenCvStereo peer(p.scene.rig());
  for (auto _ : state) {
    peer.process(mat(p.left), mat(p.right), {}, static_cast<int>(state.range(0)));
    benchmark::DoNotOptimize(peer.points.data());
  }
  state.counters["points"] = static_cast<double>(peer.left.size());
  state.counters["correct"] = static_cast<double>(correctMatches(p, peer.left, peer.right));
}

void BM_Fathom(benchmark::State& state) {
  runFathom(state, fastestKernels(), pair(false));
}
void BM_OpenCvPeer(benchmark::State& state) {
  runPeer(state, pair(false));
}
void BM_FathomBaselineKernels(benchmark::State& state) {
  runFathom(state, baselineKernels(), pair(false));
}
void BM_FathomEqualLight(benchmark::State& state) {
  runFathom(state, fastestKernels(), pair(true));
}
void BM_OpenCvPeerEqualLight(benchmark::State& state) {
  runPeer(state, pair(true));
}

void sweep(benchmark::internal::Benchmark* b) {
  b->Unit(benchmark::kMillisecond);
  for (const int features : {200, 400, 800, 1600, 3200, 5000}) b->Arg(features);
}
BENCHMARK(BM_Fathom)->Apply(sweep);
BENCHMARK(BM_OpenCvPeer)->Apply(sweep);
BENCHMARK(BM_FathomBaselineKernels)->Arg(kFeatures)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_FathomEqualLight)->Arg(kFeatures)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_OpenCvPeerEqualLight)->Arg(kFeatures)->Unit(benchmark::kMillisecond);

// The console's table, and below it the ratios of the fastest repetitions and the time that a feature costs.
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
    ratio("one thread", "BM_Fathom", "BM_OpenCvPeer");
    ratio("one thread, baseline kernels", "BM_FathomBaselineKernels", "BM_OpenCvPeer");
    ratio("one thread, equal light", "BM_FathomEqualLight", "BM_OpenCvPeerEqualLight");
    for (const char* name : {"BM_Fathom", "BM_OpenCvPeer"})
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
    if (!std::isfinite(best(fathom, kFeatures) + best(peer, kFeatures))) return;
    std::printf("sparse stereo, %d corners, %s: Fathom / OpenCV time = %.2f\n", kFeatures, what,
                best(fathom, kFeatures) / best(peer, kFeatures));
  }

  std::map<std::string, double> best_;  // CPU time [ms]
};

}  // namespace
}  // namespace fathom::stereo

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  fathom::stereo::RatioReporter reporter;
  benchmark::RunSpecifiedBenchmarks(&reporter);
  return 0;
}

#include <benchmark/benchmark.h>

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "recon/stereo/kernels/kernels.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/common/opencv_stereo.hpp"
#include "tests/world/pictures.hpp"

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

// Counters: points, correct ones, and the mean time of each stage [ms].
void runFathom(benchmark::State& state, const Kernels& kernels, const Pair& p) {
  SparseStereo stereo(p.scene.rig(), {.max_features = static_cast<int>(state.range(0))}, &kernels);
  std::map<std::string, double> stages;
  double last = 0;
  stereo.setStageObserver([&](const char* stage) {
    const double now = bench::cpuMs();
    stages[stage] += now - last;
    last = now;
  });
  const StereoResult* result = nullptr;
  for (auto _ : state) {
    last = bench::cpuMs();
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

void stereoFathom(benchmark::State& state) {
  runFathom(state, fastestKernels(), pair(false));
}
void stereoOpenCv(benchmark::State& state) {
  runPeer(state, pair(false));
}
void stereoBaselineKernels(benchmark::State& state) {
  runFathom(state, baselineKernels(), pair(false));
}
void stereoEqualLight(benchmark::State& state) {
  runFathom(state, fastestKernels(), pair(true));
}
void stereoOpenCvEqualLight(benchmark::State& state) {
  runPeer(state, pair(true));
}

void sweep(benchmark::internal::Benchmark* b) {
  b->Unit(benchmark::kMillisecond);
  for (const int features : {200, 400, 800, 1600, 3200, 5000}) b->Arg(features);
}
BENCHMARK(stereoFathom)->Apply(sweep);
BENCHMARK(stereoOpenCv)->Apply(sweep);
BENCHMARK(stereoBaselineKernels)->Arg(kFeatures)->Unit(benchmark::kMillisecond);
BENCHMARK(stereoEqualLight)->Arg(kFeatures)->Unit(benchmark::kMillisecond);
BENCHMARK(stereoOpenCvEqualLight)->Arg(kFeatures)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fathom::stereo

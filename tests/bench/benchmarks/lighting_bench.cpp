// Lighting correction of full-size images against a straightforward OpenCV one: full-size gain and offset in
// float, multiply, add, convert to 8 bits.
#include <benchmark/benchmark.h>

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <random>
#include <vector>

#include "recon/lighting/lighting_model.hpp"

namespace {

using fathom::ImageView, fathom::PixelFormat;

constexpr int kWidth = 1360, kHeight = 1024, kBits = 12;  // of a Prosilica GC1380

struct Scene {
  std::vector<std::uint16_t> samples;
  fathom::lighting::RangeLattice range;
  ImageView view(PixelFormat format) const {
    return {samples.data(), kWidth, kHeight, kWidth * sizeof(std::uint16_t), format, kBits};
  }
};

Scene makeScene(unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> sample(200, 2000);
  Scene scene;
  for (int k = 0; k < kWidth * kHeight; ++k)
    scene.samples.push_back(static_cast<std::uint16_t>(sample(random)));
  for (float& path : scene.range.path) path = 2.0F + 0.1F * static_cast<float>(seed % 7);
  return scene;
}

fathom::lighting::LightingModel& learnt(PixelFormat format, fathom::lighting::LightingChoice choice) {
  static std::vector<std::unique_ptr<fathom::lighting::LightingModel>> models;
  fathom::lighting::LightingConfig config{.choice = choice};
  models.push_back(std::make_unique<fathom::lighting::LightingModel>(kWidth, kHeight, format, kBits, config));
  for (unsigned k = 0; k < 10; ++k) {
    const Scene scene = makeScene(k);
    models.back()->add(scene.view(format), scene.range);
  }
  return *models.back();
}

void lightingCorrect(benchmark::State& state, PixelFormat format, fathom::lighting::LightingChoice choice) {
  const auto& model = learnt(format, choice);
  const Scene scene = makeScene(11);
  std::vector<std::uint8_t> out(scene.samples.size());
  for (auto _ : state) {
    model.correct(scene.view(format), scene.range, out.data());
    benchmark::DoNotOptimize(out.data());
    benchmark::ClobberMemory();
  }
}

void lightingOpenCv(benchmark::State& state) {
  const Scene scene = makeScene(11);
  const cv::Mat in(kHeight, kWidth, CV_16U, const_cast<std::uint16_t*>(scene.samples.data()));
  const cv::Mat gain(kHeight, kWidth, CV_32F, cv::Scalar(0.1)),
      offset(kHeight, kWidth, CV_32F, cv::Scalar(3));
  cv::Mat wide, product, sum, out;
  cv::setNumThreads(0);
  for (auto _ : state) {
    in.convertTo(wide, CV_32F);
    cv::multiply(wide, gain, product);
    cv::add(product, offset, sum);
    sum.convertTo(out, CV_8U);
    benchmark::DoNotOptimize(out.data);
    benchmark::ClobberMemory();
  }
}

void lightingCopy(benchmark::State& state) {
  const Scene scene = makeScene(11);
  std::vector<std::uint16_t> out(scene.samples.size());
  for (auto _ : state) {
    std::copy(scene.samples.begin(), scene.samples.end(), out.begin());
    benchmark::DoNotOptimize(out.data());
    benchmark::ClobberMemory();
  }
}

void lightingAdd(benchmark::State& state, PixelFormat format, bool solve) {
  auto& model = learnt(format, fathom::lighting::LightingChoice::kAuto);
  const Scene scene = makeScene(11);
  // Past the 64th image, one in 32 solves the models; up to it, every one does.
  if (!solve)
    while (model.images() < 4096) model.add(scene.view(format), scene.range);
  for (auto _ : state) {
    model.add(scene.view(format), scene.range);
    if (solve && model.images() == 63) state.SkipWithError("too many");
  }
}

using fathom::lighting::LightingChoice;
BENCHMARK_CAPTURE(lightingCorrect, plain_mono, PixelFormat::kMono, LightingChoice::kPlain)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(lightingCorrect, range_mono, PixelFormat::kMono, LightingChoice::kRangeDependent)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(lightingCorrect, plain_bayer, PixelFormat::kBayerRggb, LightingChoice::kPlain)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(lightingCorrect, range_bayer, PixelFormat::kBayerRggb, LightingChoice::kRangeDependent)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(lightingOpenCv)->Unit(benchmark::kMillisecond);
BENCHMARK(lightingCopy)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(lightingAdd, learn_and_solve_bayer, PixelFormat::kBayerRggb, true)
    ->Iterations(40)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(lightingAdd, learn_and_solve_mono, PixelFormat::kMono, true)
    ->Iterations(40)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(lightingAdd, learn_late_bayer, PixelFormat::kBayerRggb, false)
    ->Iterations(60)
    ->Unit(benchmark::kMillisecond);

}  // namespace

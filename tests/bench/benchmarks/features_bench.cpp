// Root-SIFT features of an image as FeatureExtractor sees it (half of a half-size one), beside OpenCV's SIFT
// with the same settings: all key points, and descriptors of the 600 strongest. Counters: points; agree, the
// share of our points that OpenCV finds within half a pixel.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "recon/closure/scale_space.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::closure {
namespace {

constexpr double kContrast = 0.02;
constexpr std::size_t kDescribed = 600;

const cv::Mat& picture() {
  static const cv::Mat small = [] {
    const test::Sheet floor{
        [](double x, double y) { return 2.0 + 0.2 * x + 0.05 * std::sin(9 * x) * std::cos(7 * y); }};
    const test::SyntheticScene scene(test::croppedRig(1360, 1024), {floor});
    const test::GrayImage left = scene.render({1.0, 0.0, 2.0}, {1.0, 0.0, 2.0}).first;
    const cv::Mat whole(left.height, left.width, CV_8UC1, const_cast<std::uint8_t*>(left.pixels.data()));
    cv::Mat out;
    cv::resize(whole, out, {340, 256}, 0, 0, cv::INTER_AREA);
    return out;
  }();
  return small;
}

std::vector<cv::KeyPoint> detected(const cv::Ptr<cv::SIFT>& detector) {
  std::vector<cv::KeyPoint> points;
  detector->detect(picture(), points);
  std::sort(points.begin(), points.end(),
            [](const auto& a, const auto& b) { return a.response > b.response; });
  return points;
}

void featuresFathom(benchmark::State& state) {
  ScaleSpace scale_space(kContrast);
  const cv::Mat& image = picture();
  std::array<float, ScaleSpace::kDescriptor> descriptor{};
  std::vector<KeyPoint> points;
  for (auto _ : state) {
    points = scale_space.detect({image.data, image.cols, image.rows, image.step});
    for (std::size_t k = 0; k < std::min(kDescribed, points.size()); ++k) {
      scale_space.describe(points[k], descriptor);
      benchmark::DoNotOptimize(descriptor.data());
    }
  }
  constexpr float kShift = -0.25F;  // of what OpenCV 4.6 finds, off the true place [px]
  const std::vector<cv::KeyPoint> peers = detected(cv::SIFT::create(0, 3, kContrast));
  const auto agree = std::count_if(points.begin(), points.end(), [&](const KeyPoint& p) {
    return std::any_of(peers.begin(), peers.end(), [&](const cv::KeyPoint& q) {
      return std::hypot(p.x - q.pt.x - kShift, p.y - q.pt.y - kShift) < 0.5F;
    });
  });
  state.counters["points"] = static_cast<double>(points.size());
  state.counters["agree"] = static_cast<double>(agree) / static_cast<double>(points.size());
}

void featuresOpenCv(benchmark::State& state) {
  cv::setNumThreads(0);
  const cv::Ptr<cv::SIFT> detector = cv::SIFT::create(0, 3, kContrast);
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
  for (auto _ : state) {
    points = detected(detector);
    std::vector<cv::KeyPoint> strongest(
        points.begin(), points.begin() + static_cast<std::ptrdiff_t>(std::min(kDescribed, points.size())));
    detector->compute(picture(), strongest, descriptors);
    benchmark::DoNotOptimize(descriptors.data);
  }
  state.counters["points"] = static_cast<double>(points.size());
}

BENCHMARK(featuresFathom)->Unit(benchmark::kMillisecond);
BENCHMARK(featuresOpenCv)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fathom::closure

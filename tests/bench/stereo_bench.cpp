#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "recon/stereo/sparse_stereo.hpp"
#include "tests/stereo/synthetic_scene.hpp"

namespace fathom::stereo {
namespace {

using Pixels = std::vector<cv::Point2f>;

constexpr int kFeatures = 800;
constexpr double kCorrect = 0.5;  // largest error of a correct match [px]

struct Pair {
  test::SyntheticScene scene;
  test::GrayImage left, right;
};

// A full-size pair of a rolling, sloping floor at 2 m, the right image darker and noisier.
const Pair& pair() {
  static const Pair p = [] {
    const test::Sheet floor{
        [](double x, double y) { return 2.0 + 0.2 * x + 0.05 * std::sin(9 * x) * std::cos(7 * y); }};
    Pair made{test::SyntheticScene(test::croppedRig(1360, 1024), {floor}), {}, {}};
    std::tie(made.left, made.right) = made.scene.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
    return made;
  }();
  return p;
}

std::size_t correctMatches(const Pixels& left, const Pixels& right) {
  std::size_t correct = 0;
  for (std::size_t i = 0; i < left.size(); ++i) {
    Eigen::Vector3d point;
    if (!pair().scene.pointAt({left[i].x, left[i].y}, point)) continue;
    const Eigen::Vector2d truth = pair().scene.rightPixel(point);
    correct += std::hypot(right[i].x - truth.x(), right[i].y - truth.y()) < kCorrect ? 1 : 0;
  }
  return correct;
}

void BM_FathomSparseStereo(benchmark::State& state) {
  SparseStereoConfig config;
  config.max_features = kFeatures;
  SparseStereo stereo(pair().scene.rig(), config);
  Pixels left, right;
  for (auto _ : state) {
    const StereoResult& result = stereo.process(pair().left.view(), pair().right.view(), {});
    benchmark::DoNotOptimize(result.points.data());
    left.clear(), right.clear();
    for (const StereoPoint& p : result.points) {
      left.emplace_back(p.left.x(), p.left.y());
      right.emplace_back(p.right.x(), p.right.y());
    }
  }
  state.counters["points"] = static_cast<double>(left.size());
  state.counters["correct"] = static_cast<double>(correctMatches(left, right));
}

// What one writes with OpenCV: Harris corners, pyramidal Lucas-Kanade there and back from the plane's seeds,
// the same filters and triangulation. No triangles and no outlier check.
struct OpenCvStereo {
  explicit OpenCvStereo(const StereoRig& r) : rig(r) {
    const Eigen::Vector3d& t = rig.T_right_left.translation();
    Eigen::Matrix3d cross;
    cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
    essential = cross * rig.T_right_left.matrix3();
  }

  void process(const cv::Mat& left_image, const cv::Mat& right_image, const SeedPlane& plane) {
    constexpr double kQuality = 1e-4, kMinDistance = 15, kHarrisK = 0.04;
    constexpr int kBlock = 5, kTopLevel = 2, kIterations = 20;
    const cv::Size window(15, 15);
    const cv::TermCriteria stop(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, kIterations, 0.01);
    const SparseStereoConfig limits;
    left.clear(), right.clear(), points.clear();
    Pixels corners;
    cv::goodFeaturesToTrack(left_image, corners, kFeatures, kQuality, kMinDistance, cv::noArray(), kBlock,
                            true, kHarrisK);
    Pixels there;
    for (const cv::Point2f& c : corners) {
      const Eigen::Vector3d ray = rig.left.ray({c.x, c.y});
      const Eigen::Vector2d seed =
          rig.right.project(rig.T_right_left * (ray * (plane.distance / plane.normal.dot(ray))));
      there.emplace_back(static_cast<float>(seed.x()), static_cast<float>(seed.y()));
    }
    std::vector<cv::Mat> left_pyramid, right_pyramid;
    cv::buildOpticalFlowPyramid(left_image, left_pyramid, window, kTopLevel);
    cv::buildOpticalFlowPyramid(right_image, right_pyramid, window, kTopLevel);
    std::vector<std::uint8_t> found, found_back;
    cv::calcOpticalFlowPyrLK(left_pyramid, right_pyramid, corners, there, found, cv::noArray(), window,
                             kTopLevel, stop, cv::OPTFLOW_USE_INITIAL_FLOW);
    Pixels back = corners;
    cv::calcOpticalFlowPyrLK(right_pyramid, left_pyramid, there, back, found_back, cv::noArray(), window,
                             kTopLevel, stop, cv::OPTFLOW_USE_INITIAL_FLOW);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      if (found[i] == 0 || found_back[i] == 0) continue;
      if (std::hypot(back[i].x - corners[i].x, back[i].y - corners[i].y) > limits.max_left_right_distance)
        continue;
      const Eigen::Vector3d left_ray = rig.left.ray({corners[i].x, corners[i].y});
      const Eigen::Vector3d right_ray = rig.right.ray({there[i].x, there[i].y});
      const Eigen::Vector3d line = essential * left_ray;
      if (std::abs(line.dot(right_ray)) / line.head<2>().norm() * rig.right.fx > limits.max_epipolar_distance)
        continue;
      Eigen::Vector3d point;
      double gap = 0;
      if (!triangulateMidpoint(rig, left_ray, right_ray, point, gap)) continue;
      if (point.z() < limits.min_range || point.z() > limits.max_range) continue;
      left.push_back(corners[i]);
      right.push_back(there[i]);
      points.push_back(point);
    }
  }

  StereoRig rig;
  Eigen::Matrix3d essential;
  Pixels left, right;
  std::vector<Eigen::Vector3d> points;
};

void BM_OpenCvPeer(benchmark::State& state) {
  cv::setNumThreads(1);
  const auto mat = [](const test::GrayImage& image) {
    return cv::Mat(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.pixels.data()));
  };
  OpenCvStereo peer(pair().scene.rig());
  for (auto _ : state) {
    peer.process(mat(pair().left), mat(pair().right), {});
    benchmark::DoNotOptimize(peer.points.data());
  }
  state.counters["points"] = static_cast<double>(peer.left.size());
  state.counters["correct"] = static_cast<double>(correctMatches(peer.left, peer.right));
}

BENCHMARK(BM_FathomSparseStereo)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_OpenCvPeer)->Unit(benchmark::kMillisecond);

// The console's table, and the ratio of the two fastest repetitions below it.
class RatioReporter : public benchmark::ConsoleReporter {
 public:
  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      if (run.run_type != Run::RT_Iteration || run.error_occurred) continue;
      double& best = run.benchmark_name().find("Fathom") != std::string::npos ? fathom_ : peer_;
      best = std::min(best, run.GetAdjustedCPUTime());
    }
  }
  void Finalize() override {
    if (std::isfinite(fathom_) && std::isfinite(peer_))
      std::printf("sparse stereo, %d corners, one thread: Fathom / OpenCV time = %.2f\n", kFeatures,
                  fathom_ / peer_);
    ConsoleReporter::Finalize();
  }

 private:
  double fathom_ = INFINITY, peer_ = INFINITY;  // CPU time [ms]
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

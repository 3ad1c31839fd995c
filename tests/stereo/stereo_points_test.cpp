#include <gtest/gtest.h>
#include <zlib.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "recon/geometry/uncertain_pose.hpp"
#include "recon/stereo/match_points.hpp"
#include "recon/stereo/point_filter.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::stereo {
namespace {

using test::croppedRig, test::Exposure, test::Sheet, test::SyntheticScene;

struct Normalised {
  double sigma;  // reported [m]
  double error;  // of z, in reported standard deviations
};

double rms(const std::vector<Normalised>& errors, std::size_t begin, std::size_t end) {
  double sum = 0;
  for (std::size_t i = begin; i < end; ++i) sum += errors[i].error * errors[i].error;
  return std::sqrt(sum / static_cast<double>(end - begin));
}

// Tilted ground, so that windows differ by more than noise.
std::vector<Normalised> errorsOf(const Exposure& left_exposure, const Exposure& right_exposure) {
  const Sheet floor{[](double x, double y) { return 2.0 + 0.2 * x + 0.1 * y; }};
  const SyntheticScene scene(croppedRig(640, 480), {floor});
  const auto [left, right] = scene.render(left_exposure, right_exposure);
  SparseStereo stereo(scene.rig(), {.max_features = 1200});
  std::vector<Normalised> errors;
  for (const StereoPoint& p : stereo.process(left.view(), right.view(), {}).points) {
    Eigen::Vector3d truth;
    if (!scene.pointAt(p.left.cast<double>(), truth)) continue;
    const double sigma = static_cast<double>(p.sigma_z);
    errors.push_back({sigma, (static_cast<double>(p.point.z()) - truth.z()) / sigma});
  }
  std::sort(errors.begin(), errors.end(),
            [](const Normalised& a, const Normalised& b) { return a.sigma < b.sigma; });
  return errors;
}

class SigmaZ : public testing::TestWithParam<std::pair<Exposure, Exposure>> {};

TEST_P(SigmaZ, MatchesTheErrorsWithinAFifthInEveryThirdOfThePointsRankedByIt) {
  const auto errors = errorsOf(GetParam().first, GetParam().second);
  const std::size_t n = errors.size();
  ASSERT_GE(n, 900U);
  EXPECT_NEAR(rms(errors, 0, n), 1.0, 0.2);
  for (std::size_t third = 0; third < 3; ++third)
    EXPECT_NEAR(rms(errors, third * n / 3, (third + 1) * n / 3), 1.0, 0.2) << third;
  // Reported sigmas differ in fact: points in the worst tenth are clearly less accurate.
  EXPECT_GE(errors[n * 9 / 10].sigma, 1.2 * errors[n / 10].sigma);
}

INSTANTIATE_TEST_SUITE_P(Noise, SigmaZ,
                         testing::Values(std::pair<Exposure, Exposure>{{1.0, 0.0, 1.0}, {1.0, 0.0, 1.0}},
                                         std::pair<Exposure, Exposure>{{1.0, 0.0, 2.0}, {0.8, 12.0, 3.0}},
                                         std::pair<Exposure, Exposure>{{1.0, 0.0, 6.0}, {0.6, 20.0, 4.0}}));

// Root mean square of the errors of z [m], and of the errors in reported standard deviations.
struct RmsErrors {
  double metres = 0, sigmas = 0;
};

RmsErrors rmsErrors(const SyntheticScene& scene, const StereoResult& result) {
  RmsErrors sum;
  for (const StereoPoint& p : result.points) {
    Eigen::Vector3d truth;
    EXPECT_TRUE(scene.pointAt(p.left.cast<double>(), truth));
    const double error = static_cast<double>(p.point.z()) - truth.z();
    sum.metres += error * error;
    sum.sigmas += std::pow(error / static_cast<double>(p.sigma_z), 2);
  }
  const auto n = static_cast<double>(result.points.size());
  return {std::sqrt(sum.metres / n), std::sqrt(sum.sigmas / n)};
}

struct FilterCase {
  const char* name;
  std::vector<Sheet> sheets;
  double most;  // of the error, over that before
};

class PointFilterOn : public testing::TestWithParam<FilterCase> {};

TEST_P(PointFilterOn, TakesOutNoiseAndLeavesReliefAndItsClaimHolds) {
  const SyntheticScene scene(croppedRig(640, 480), GetParam().sheets);
  const auto [left, right] = scene.render({1.0, 0.0, 6.0}, {0.6, 20.0, 4.0});
  SparseStereo stereo(scene.rig(), {.max_features = 1200});
  const StereoResult& found = stereo.process(left.view(), right.view(), {});
  StereoResult smooth = found;
  smoothPoints(smooth);
  const RmsErrors before = rmsErrors(scene, found), after = rmsErrors(scene, smooth);
  std::printf("%zu points: %.1f mm (%.2f sigma) before, %.1f mm (%.2f sigma) after\n", found.points.size(),
              1000 * before.metres, before.sigmas, 1000 * after.metres, after.sigmas);
  EXPECT_LE(after.metres, GetParam().most * before.metres);
  EXPECT_LE(after.sigmas, 1.25);
  for (std::size_t i = 0; i < found.points.size(); ++i) {
    EXPECT_EQ(smooth.points[i].left, found.points[i].left);
    EXPECT_LE(smooth.points[i].sigma_z, found.points[i].sigma_z);
    EXPECT_NEAR(std::sqrt(smooth.points[i].covariance[5]), smooth.points[i].sigma_z,
                1e-3F * smooth.points[i].sigma_z);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Ground, PointFilterOn,
    testing::Values(
        FilterCase{"Plane", {{[](double x, double y) { return 2.0 + 0.2 * x + 0.1 * y; }}}, 0.7},
        FilterCase{"Waves",
                   {{[](double x, double y) { return 2.0 + 0.03 * std::sin(12 * x) * std::sin(9 * y); }}},
                   0.7},
        FilterCase{"Rubble",
                   {{[](double x, double y) { return 2.0 + 0.1 * std::sin(40 * x) * std::sin(35 * y); }}},
                   1.05},
        FilterCase{"Step",
                   {{[](double, double) { return 2.0; }},
                    {[](double, double) { return 1.7; }, [](double x, double) { return x > 0; }}},
                   0.7}),
    [](const auto& instance) { return instance.param.name; });

TEST(MidpointTriangulation, AgreesWithTheRigsOwnAndItsCovarianceWithNumericalDerivatives) {
  const StereoRig rig = croppedRig(1360, 1024);
  const MidpointTriangulation triangulation(rig);
  const Eigen::Vector2d left(1204, 133),
      right_true = rig.right.project(rig.T_right_left * (rig.left.ray(left) * 2.3));
  const Eigen::Vector2d right = right_true + Eigen::Vector2d(0.1, 0.3);  // rays that do not meet
  const auto point = [&](const Eigen::Vector2d& l, const Eigen::Vector2d& r) {
    Eigen::Vector3d p;
    EXPECT_TRUE(triangulation.point(rig.left.ray(l), rig.right.ray(r), p));
    return p;
  };
  Eigen::Vector3d expected;
  double gap = 0;
  ASSERT_TRUE(triangulateMidpoint(rig, rig.left.ray(left), rig.right.ray(right), expected, gap));
  EXPECT_LT((point(left, right) - expected).norm(), 1e-9);

  Eigen::Matrix2d s_left, s_right;
  s_left << 0.02, 0.005, 0.005, 0.01;
  s_right << 0.03, -0.01, -0.01, 0.04;
  Eigen::Matrix<double, 3, 4> jacobian;
  constexpr double kStep = 1e-4;  // [px]
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(i);
    jacobian.col(i) = (point(left + step, right) - point(left - step, right)) / (2 * kStep);
    jacobian.col(2 + i) = (point(left, right + step) - point(left, right - step)) / (2 * kStep);
  }
  Eigen::Matrix4d pixels = Eigen::Matrix4d::Zero();
  pixels.topLeftCorner<2, 2>() = s_left;
  pixels.bottomRightCorner<2, 2>() = s_right;
  const Eigen::Matrix3d numerical = jacobian * pixels * jacobian.transpose();
  const Eigen::Matrix3d analytic =
      triangulation.covariance(rig.left.ray(left), rig.right.ray(right), s_left, s_right);
  EXPECT_LT((analytic - numerical).norm(), 1e-5 * numerical.norm());
}

TEST(MidpointTriangulation, DepthErrorFollowsTheTheoryOfParallelCameras) {
  StereoRig rig;
  rig.left = rig.right = Camera{.width = 1000, .height = 800, .fx = 1000, .fy = 1000, .cx = 500, .cy = 400};
  rig.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {-0.1, 0, 0});
  const double z = 3.0, sigma_d = 0.2;
  const Eigen::Vector2d left(500, 400), right(500 - 1000 * 0.1 / z, 400);
  const Eigen::Matrix3d c =
      MidpointTriangulation(rig).covariance(rig.left.ray(left), rig.right.ray(right), Eigen::Matrix2d::Zero(),
                                            Eigen::Vector2d(sigma_d * sigma_d, 0).asDiagonal());
  EXPECT_NEAR(std::sqrt(c(2, 2)), z * z * sigma_d / (1000 * 0.1), 1e-3 * z * z * sigma_d / 100);
}

TEST(MidpointTriangulation, RaysThatAreParallelOrMeetBehindTheCamerasGiveNoPoint) {
  const StereoRig rig = croppedRig(1360, 1024);
  const MidpointTriangulation triangulation(rig);
  Eigen::Vector3d p;
  const Eigen::Vector3d ahead(0.1, 0.2, 1);
  EXPECT_FALSE(triangulation.point(ahead, rig.T_right_left.rotation() * ahead, p));
  EXPECT_FALSE(triangulation.point({-0.3, 0, 1}, {0.3, 0, 1}, p));
}

TEST(SparseStereo, CovarianceIsPositiveDefiniteLongestAlongTheRayAndHoldsSigmaZ) {
  const SyntheticScene scene(croppedRig(640, 480), {Sheet{[](double, double) { return 2.0; }}});
  const auto [left, right] = scene.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
  SparseStereo stereo(scene.rig(), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  ASSERT_GE(result.points.size(), 700U);
  for (const StereoPoint& p : result.points) {
    const auto& c = p.covariance;
    Eigen::Matrix3d m;
    m << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
    const SymmetricEigen<3> eigen = symmetricEigen(m);
    EXPECT_GT(eigen.values[0], 0);
    EXPECT_GT(std::abs(eigen.vectors.col(2).dot(p.point.cast<double>().normalized())), 0.99);
    EXPECT_NEAR(std::sqrt(c[5]), p.sigma_z, 1e-4F * p.sigma_z);
  }
}

TEST(MatchNoise, FindsTheScaleThroughACalibrationErrorAndWrongMatches) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  MatchNoise noise(1000);
  for (int i = 0; i < 1000; ++i) {
    const double sigma = 0.03 + 0.05 * (i % 7) / 7.0;
    const double calibration = 0.2 + 0.0005 * i;
    const double distance = calibration + 1.8 * sigma * normal(random) + (i % 25 == 0 ? 0.9 : 0.0);
    noise.add({distance, {0, 1}}, Eigen::Vector2d(1, sigma * sigma).asDiagonal());
  }
  EXPECT_NEAR(noise.scale(), 1.8, 0.2);
  noise.clear();
  EXPECT_EQ(noise.scale(), MatchNoise::kUsual);
}

TEST(SparseStereo, NoFrameCallsTheHeapNotEvenTheFirst) {
  const SyntheticScene flat(croppedRig(640, 480), {Sheet{[](double, double) { return 2.0; }}});
  const SyntheticScene rough(
      croppedRig(640, 480),
      {Sheet{[](double x, double y) { return 2.4 - 0.5 * x + (x * x + y * y < 0.01 ? -0.5 : 0.0); }}}, 0.004,
      5);
  const auto [left, right] = flat.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
  const auto [other_left, other_right] = rough.render({1.0, 0.0, 6.0}, {0.8, 12.0, 6.0});
  SparseStereo stereo(flat.rig(), {.max_features = 1500});
  const auto before = test::threadCost();
  // Few, then as many as configured, then other ground with mismatches, then unrelated images.
  (void)stereo.process(left.view(), right.view(), {}, 100);
  (void)stereo.process(left.view(), right.view(), {});
  (void)stereo.process(other_left.view(), other_right.view(), {Eigen::Vector3d::UnitZ(), 2.4}, 900);
  (void)stereo.process(left.view(), other_right.view(), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {}, 1 << 20);
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0U);
  EXPECT_GE(result.points.size(), 1000U);
}

TEST(StereoMesh, FilledAgainCallsNoHeap) {
  const SyntheticScene scene(croppedRig(320, 240), {Sheet{[](double, double) { return 2.0; }}});
  const auto [left, right] = scene.render({}, {});
  SparseStereo stereo(scene.rig(), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  Mesh mesh;
  toMesh(result, left.view(), mesh);
  const auto before = test::threadCost();
  toMesh(result, left.view(), mesh);
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0U);
  ASSERT_EQ(mesh.vertices.size(), result.points.size());
  EXPECT_EQ(mesh.colours.size(), result.points.size());
}

struct FloatArray {
  int rows = 0, columns = 0;
  std::vector<float> values;
  [[nodiscard]] float at(int row, int column) const {
    return values[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                  static_cast<std::size_t>(column)];
  }
};

std::uint32_t number(const std::string& bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = size; i-- > 0;) value = value << 8 | static_cast<std::uint8_t>(bytes.at(at + i));
  return value;
}

// Content of the archive's first file. Sizes come from the central directory: the local header may leave
// them out.
std::string firstFile(const std::string& zip) {
  constexpr std::uint32_t kDirectoryEnd = 0x06054b50;
  std::size_t end = zip.size() >= 22 ? zip.size() - 22 : 0;
  while (end > 0 && number(zip, end, 4) != kDirectoryEnd) --end;
  if (end == 0) throw std::runtime_error("not a zip archive");
  const std::size_t directory = number(zip, end + 16, 4);
  const std::uint32_t method = number(zip, directory + 10, 2);
  const std::uint32_t packed = number(zip, directory + 20, 4), size = number(zip, directory + 24, 4);
  const std::size_t local = number(zip, directory + 42, 4);
  const std::size_t data = local + 30 + number(zip, local + 26, 2) + number(zip, local + 28, 2);
  if (method == 0) return zip.substr(data, size);
  std::string content(size, '\0');
  z_stream stream{};
  if (method != 8 || inflateInit2(&stream, -MAX_WBITS) != Z_OK)
    throw std::runtime_error("unknown compression");
  std::string input = zip.substr(data, packed);
  stream.next_in = reinterpret_cast<Bytef*>(input.data());
  stream.avail_in = packed;
  stream.next_out = reinterpret_cast<Bytef*>(content.data());
  stream.avail_out = size;
  const int status = inflate(&stream, Z_FINISH);
  inflateEnd(&stream);
  if (status != Z_STREAM_END) throw std::runtime_error("damaged zip archive");
  return content;
}

// The first array of a .npz file (a zip of .npy), which must be two-dimensional little-endian float32 in C
// order, stored or deflated. Throws std::runtime_error for anything else.
FloatArray readNpz(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string npy = firstFile({std::istreambuf_iterator<char>(in), {}});
  const std::size_t header = number(npy, 8, 2);
  const std::string text = npy.substr(10, header);
  const std::size_t shape = text.find("'shape': (");
  FloatArray array;
  if (text.find("'<f4'") == std::string::npos || text.find("'fortran_order': False") == std::string::npos ||
      shape == std::string::npos ||
      std::sscanf(text.c_str() + shape, "'shape': (%d, %d)", &array.rows, &array.columns) != 2)
    throw std::runtime_error("not a two-dimensional float32 array");
  array.values.resize(static_cast<std::size_t>(array.rows) * static_cast<std::size_t>(array.columns));
  if (npy.size() != 10 + header + array.values.size() * sizeof(float))
    throw std::runtime_error("array is cut");
  std::memcpy(array.values.data(), npy.data() + 10 + header, array.values.size() * sizeof(float));
  return array;
}

ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, image.step, PixelFormat::kMono, 8};
}

// Middlebury 2014 Motorcycle, quarter size (Scharstein et al.): a rectified pair, left(x) matches right(x -
// d), and Z = f B / (d + doffs), so that the right camera's centre is doffs to the right of the left's.
TEST(Middlebury, MotorcycleDisparitiesAgreeWithTheTruth) {
  FATHOM_REQUIRE_DATA("stereo/motorcycle_left.png");
  constexpr double kFocal = 994.978, kCx = 311.193, kCy = 254.877, kDoffs = 31.086;  // [px]
  constexpr double kBaseline = 0.193001;                                             // [m]
  const cv::Mat left = cv::imread(test::dataFile("stereo/motorcycle_left.png"), cv::IMREAD_GRAYSCALE);
  const cv::Mat right = cv::imread(test::dataFile("stereo/motorcycle_right.png"), cv::IMREAD_GRAYSCALE);
  const FloatArray truth = readNpz(test::dataFile("stereo/motorcycle_disp.npz"));
  ASSERT_EQ(truth.rows, left.rows);
  ASSERT_EQ(truth.columns, left.cols);

  StereoRig rig;
  rig.left = {left.cols, left.rows, kFocal, kFocal, kCx, kCy};
  rig.right = rig.left;
  rig.right.cx += kDoffs;
  rig.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {-kBaseline, 0, 0});
  SparseStereoConfig config{.max_features = 5000};  // all else as on the seafloor
  SparseStereo stereo(rig, config);
  // A workshop, not a seafloor: most of it is about three metres away, no more is known.
  const StereoResult& result = stereo.process(viewOf(left), viewOf(right), {Eigen::Vector3d::UnitZ(), 2.9});

  std::vector<double> errors;
  for (const StereoPoint& p : result.points) {
    const double d = static_cast<double>(
        truth.at(static_cast<int>(std::lround(p.left.y())), static_cast<int>(std::lround(p.left.x()))));
    if (std::isfinite(d)) errors.push_back(std::abs(static_cast<double>(p.left.x() - p.right.x()) - d));
  }
  std::sort(errors.begin(), errors.end());
  ASSERT_GE(errors.size(), 2000U);
  const double median = errors[errors.size() / 2];
  const double bad =
      static_cast<double>(std::count_if(errors.begin(), errors.end(), [](double e) { return e > 1; })) /
      static_cast<double>(errors.size());
  std::printf("%zu points with truth, median %.3f px, beyond 1 px %.2f %%\n", errors.size(), median,
              100 * bad);
  EXPECT_LE(median, 0.15);
  EXPECT_LE(bad, 0.03);
}

}  // namespace
}  // namespace fathom::stereo

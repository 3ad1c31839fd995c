#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "firmware_if/mission/images/image_file.hpp"
#include "recon/topside/localise/first_links.hpp"
#include "recon/topside/localise/ground_alignment.hpp"
#include "recon/topside/pipeline.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::topside {
namespace {

// Level ground without features, mud: laid on each other by all pixels.

constexpr double kTexel = 0.004, kExtent = 12;  // of the ground [m]

// Blotches of a few grey levels, a centimetre wide.
cv::Mat mud() {
  const int side = static_cast<int>(kExtent / kTexel);
  cv::Mat ground(side, side, CV_32F);
  cv::theRNG().state = 7;
  cv::randn(ground, 0, 1);
  constexpr double kBlotch = 2.5, kContrast = 4;  // [texels], [grey levels]
  cv::GaussianBlur(ground, ground, {}, kBlotch);
  cv::Scalar mean, spread;
  cv::meanStdDev(ground, mean, spread);
  return ground * (kContrast / spread[0]);
}

Camera camera() {
  return {680, 512, 870, 870, 339.5, 255.5, 0.15, 0.3, 0.001, -0.002, 0};
}

// A tilted camera 1.4 m above level ground; world: z down, ground at z = 0.
SE3 poseAt(double north, double east, double heading) {
  constexpr double kTilt = 0.6, kHeight = 1.4;  // [rad], [m]
  return SE3::fromEuler(kTilt, 0, heading, {north, east, -kHeight});
}

// What it sees under a lamp that it carries, blurred along its track and noisy.
GroundView seen(const cv::Mat& ground, const SE3& T_world_cam, unsigned seed) {
  const Camera c = camera();
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, 1.5F);
  cv::Mat x(c.height, c.width, CV_32F), y(c.height, c.width, CV_32F), image;
  for (int v = 0; v < c.height; ++v)
    for (int u = 0; u < c.width; ++u) {
      const Eigen::Vector3d ray = T_world_cam.rotation() * c.ray({u, v});
      const Eigen::Vector3d p = T_world_cam.translation() - T_world_cam.translation().z() / ray.z() * ray;
      x.at<float>(v, u) = static_cast<float>((p.x() + kExtent / 2) / kTexel);
      y.at<float>(v, u) = static_cast<float>((p.y() + kExtent / 2) / kTexel);
    }
  cv::remap(ground, image, x, y, cv::INTER_LINEAR, cv::BORDER_REFLECT);
  cv::blur(image, image, {7, 3});
  GroundView out;
  out.mono.create(image.size(), CV_8U);
  for (int v = 0; v < c.height; ++v)
    for (int u = 0; u < c.width; ++u) {
      const double off = std::hypot((u - 300.0) / c.width, (v - 330.0) / c.height);
      const double lamp = std::exp(-3 * off * off);
      out.mono.at<std::uint8_t>(v, u) =
          cv::saturate_cast<std::uint8_t>(20 + lamp * (70 + 3 * image.at<float>(v, u)) + noise(random));
    }
  const Eigen::Vector3d normal = T_world_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  out.plane = {normal, -T_world_cam.translation().z()};
  return out;
}

TEST(GroundAlignment, FramesOfBareMudAreLaidOnEachOther) {
  const cv::Mat ground = mud();
  const SE3 a = poseAt(0, 0, 0.2), b = poseAt(0.35, 0.2, 0.36);
  const GroundAlignment found = alignGround(camera(), seen(ground, a, 1), seen(ground, b, 2));
  ASSERT_EQ(found.refusal, closure::Refusal::kNone)
      << closure::nameOf(found.refusal) << ": " << found.inliers << " of " << found.tracked
      << " points, correlation " << found.correlation;
  const Vector6d error = ((a.inverse() * b).inverse() * found.pose.T_a_b).log();
  const double chi2 = error.dot(found.pose.covariance.inverse() * error);
  std::printf("%d of %d points, correlation %.2f: off by %.2f mm, %.3f deg, chi2 %.1f\n", found.inliers,
              found.tracked, found.correlation, 1e3 * error.head<3>().norm(), 57.3 * error.tail<3>().norm(),
              chi2);
  EXPECT_LT(error.head<3>().norm(), 0.0013);
  EXPECT_LT(error.tail<3>().norm(), 0.0006);
  EXPECT_LT(chi2, 22.46);
  EXPECT_GT(found.inliers, 165);
}

TEST(GroundAlignment, TheReverseIsTheInverse) {
  const cv::Mat ground = mud();
  const SE3 a = poseAt(0, 0, 0.2), b = poseAt(0.35, 0.2, 0.36);
  const GroundAlignment found = alignGround(camera(), seen(ground, b, 2), seen(ground, a, 1));
  ASSERT_EQ(found.refusal, closure::Refusal::kNone);
  const Vector6d error = ((b.inverse() * a).inverse() * found.pose.T_a_b).log();
  EXPECT_LT(error.head<3>().norm(), 0.0013);
  EXPECT_LT(error.dot(found.pose.covariance.inverse() * error), 22.46);
}

// Round the end of a line.
TEST(GroundAlignment, ATurnThatSensorsKnowIsNotSought) {
  const cv::Mat ground = mud();
  const SE3 a = poseAt(0, 0, 0.2), b = poseAt(-0.45, -0.4, 1.1);
  const GroundView from = seen(ground, a, 1), to = seen(ground, b, 2);
  const SE3 reckoned = a.inverse() * poseAt(-0.8, 0, 1.15);
  EXPECT_NE(alignGround(camera(), from, to).refusal, closure::Refusal::kNone);
  const GroundAlignment found = alignGround(camera(), from, to, reckoned);
  ASSERT_EQ(found.refusal, closure::Refusal::kNone) << closure::nameOf(found.refusal);
  const Vector6d error = ((a.inverse() * b).inverse() * found.pose.T_a_b).log();
  std::printf("off by %.2f mm\n", 1e3 * error.head<3>().norm());
  EXPECT_LT(error.dot(found.pose.covariance.inverse() * error), 22.46);
}

// One feature each, on the ground, which registers nothing.
struct OneFeature final : FeatureStore {
  [[nodiscard]] std::size_t count(std::size_t pair) const override { return pair == kBlank ? 0 : 1; }
  void load(std::size_t, closure::FrameFeatures& out) const override {
    const SE3 T_world_cam = poseAt(0, 0, 0);
    closure::Feature f{};
    f.left = {340, 256};
    const Eigen::Vector3d ray = camera().ray(f.left.cast<double>());
    f.point = (-T_world_cam.translation().z() / (T_world_cam.rotation() * ray).z() * ray).cast<float>();
    out.features.assign(1, f);
    out.descriptors.assign(closure::kDescriptorBytes, 0);
  }
  static constexpr std::size_t kBlank = 3;
};

TEST(GroundAlignment, StepsThatFeaturesDoNotShowAreFoundByTheGround) {
  const test::TemporaryFolder folder;
  const cv::Mat ground = mud();
  MissionInput input;
  input.paths = io::MissionPaths(folder.path());
  input.rig.left = camera();
  input.mission.cameras.left_format = PixelFormat::kMono;
  input.mission.cameras.bits = 8;
  std::filesystem::create_directories(input.paths.images());
  const OneFeature store;
  Survey survey;
  Frames frames;
  frames.features = &store;
  std::vector<SE3> truth;
  for (std::uint32_t k = 0; k < 6; ++k) {
    truth.push_back(poseAt(0.3 * k, 0.1 * k, 0.1 * k));
    const GroundView view = seen(ground, truth[k], k);
    const std::string name = std::to_string(k) + ".tif";
    const cv::Mat& mono = view.mono;
    io::writeImage(input.paths.images() / name,
                   {mono.data, mono.cols, mono.rows, mono.step[0], PixelFormat::kMono, 8});
    survey.list.pairs.push_back({.utc_ns = k, .left = name, .right = name});
    survey.planes.push_back(stereo::SeedPlane{view.plane.normal, view.plane.distance});
    frames.pair.push_back(k);
    frames.reckoned.push_back(poseAt(0, 0, 0.1 * k));  // the vehicle does not know how far it went
  }
  slam::NavigationLink known;
  known.a = 1, known.b = 2;
  std::filesystem::remove(input.paths.images() / "5.tif");
  const std::vector<slam::NavigationLink> links = withGroundSteps(input, survey, frames, {known});
  ASSERT_EQ(links.size(), 2U) << "neither the blank frame's steps nor the unreadable one's";
  EXPECT_EQ(links[0].b, 1U);
  EXPECT_EQ(links[1].b, 2U);
  const Vector6d error = ((truth[0].inverse() * truth[1]).inverse() * links[0].T_a_b).log();
  EXPECT_LT(error.dot(links[0].covariance.inverse() * error), 22.46);
}

TEST(GroundAlignment, FramesThatShareNothingAreRefused) {
  const cv::Mat ground = mud();
  const GroundView a = seen(ground, poseAt(0, 0, 0.2), 1);
  for (const double away : {-4.0, -3.0, 3.0, 4.0}) {
    const GroundAlignment found = alignGround(camera(), a, seen(ground, poseAt(0, away, 0.2), 2));
    EXPECT_NE(found.refusal, closure::Refusal::kNone) << away;
  }
}

TEST(GroundAlignment, NoLightIsRefused) {
  GroundView dark = seen(mud(), poseAt(0, 0, 0), 1);
  dark.mono.setTo(0);
  EXPECT_NE(alignGround(camera(), dark, dark).refusal, closure::Refusal::kNone);
}

TEST(GroundAlignment, ARealDiveOverMudStaysInOnePart) {
  FATHOM_REQUIRE_DATA("real/haltbrekken/stereo.calib");
  const test::TemporaryFolder folder;
  RunPlaces places;
  places.mission = test::dataFile("real/haltbrekken");
  places.out = folder.path() / "out";
  places.work = folder.path() / "work";
  TopsideConfig config;
  config.model.texture = false;
  EXPECT_EQ(runTopside(places, config).used, 20u);
  const auto report = nlohmann::json::parse(std::ifstream(places.out / "report.json"));
  EXPECT_EQ(report["localisation"]["parts"].size(), 1u);
}

}  // namespace
}  // namespace fathom::topside

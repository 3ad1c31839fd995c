#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <sstream>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/camera.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/report/board_check_report.hpp"
#include "sim/boards/board_maker.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom {
namespace {

const calibration::Chessboard kBoard{9, 6, 0.08};

// Boards under water at half the images' size.
void renderBoards(const std::filesystem::path& out, int views, std::uint64_t seed) {
  sim::Scenario scenario;
  scenario.scale = 0.5;
  sim::BoardMakerOptions options;
  options.board = kBoard;
  options.poses.views = views;
  options.poses.seed = seed;
  options.out = out;
  sim::makeBoards(scenario, options);
}

topside::BoardImages boardsIn(const std::filesystem::path& folder) {
  topside::BoardImageOptions options;
  options.images = {folder / "img"};
  return topside::findBoards(options, kBoard);
}

// Distance of a corner in the right image from the epipolar line of `rig` [px].
double epipolarError(const StereoRig& rig, const Eigen::Vector2d& left, const Eigen::Vector2d& right) {
  const Eigen::Vector3d t = rig.T_right_left.translation();
  const Eigen::Vector3d line = t.cross(rig.T_right_left.rotation() * rig.left.ray(left));
  return rig.right.fx * std::abs(line.dot(rig.right.ray(right))) / line.head<2>().norm();
}

class RenderedBoards : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<test::TemporaryFolder>();
    renderBoards(folder_->path() / "one", 16, 1);
    renderBoards(folder_->path() / "other", 6, 2);
    topside::CalibrateOptions options;
    options.board = {"9x6", kBoard.square, {}};
    options.board.images.images = {folder_->path() / "one" / "img"};
    options.out = folder_->path() / "stereo.calib";
    done_ = topside::runCalibrate(options);
    truth_ = readStereoCalib(folder_->path() / "one" / "truth" / "stereo.calib");
  }
  static void TearDownTestSuite() { folder_.reset(); }
  inline static std::unique_ptr<test::TemporaryFolder> folder_;
  inline static calibration::RigCalibration done_;
  inline static StereoRig truth_;
};

TEST_F(RenderedBoards, CornersAreFoundWhereTheTruthHasThem) {
  const topside::BoardImages found = boardsIn(folder_->path() / "other");
  ASSERT_EQ(found.views.size(), 6u);
  std::ifstream file(folder_->path() / "other" / "truth" / "corners.csv");
  std::string line;
  std::getline(file, line);
  double squares = 0, worst = 0;
  for (const auto& view : found.views) {
    std::vector<Eigen::Vector2d> truth;
    for (std::size_t k = 0; k < kBoard.corners() && std::getline(file, line); ++k) {
      std::replace(line.begin(), line.end(), ',', ' ');
      std::istringstream numbers(line);
      double number, corner, u, v;
      numbers >> number >> corner >> u >> v;
      truth.emplace_back(u, v);
    }
    ASSERT_EQ(truth.size(), kBoard.corners());
    if ((truth.front() - view.left.front()).norm() > (truth.back() - view.left.front()).norm())
      std::reverse(truth.begin(), truth.end());
    for (std::size_t k = 0; k < truth.size(); ++k) {
      squares += (truth[k] - view.left[k]).squaredNorm();
      worst = std::max(worst, (truth[k] - view.left[k]).norm());
    }
  }
  const double rms = std::sqrt(squares / (6.0 * static_cast<double>(kBoard.corners())));
  std::printf("corners: RMS %.3f px, worst %.3f px\n", rms, worst);
  EXPECT_LT(rms, 0.08);
  EXPECT_LT(worst, 0.3);
}

TEST_F(RenderedBoards, CalibrationRecoversTheTrueRig) {
  std::printf("stereo RMS %.3f px; baseline %.3f +- %.3f mm (true %.3f); fx %.2f +- %.2f px (true %.2f)\n",
              done_.stereo_rms, 1e3 * done_.rig.baseline(), 1e3 * done_.sigma.baseline,
              1e3 * truth_.baseline(), done_.rig.left.fx, done_.sigma.left.fx, truth_.left.fx);
  EXPECT_TRUE(done_.dropped.empty());
  EXPECT_LT(done_.stereo_rms, 0.1);
  EXPECT_NEAR(done_.rig.baseline(), truth_.baseline(), 0.0002);
  for (const auto& [estimate, truth] :
       {std::pair(done_.rig.left, truth_.left), std::pair(done_.rig.right, truth_.right)}) {
    EXPECT_NEAR(estimate.fx / truth.fx, 1.0, 0.001);
    EXPECT_NEAR(estimate.fy / truth.fy, 1.0, 0.001);
  }
  // True corners must be on the estimated rig's epipolar lines.
  double worst = 0;
  for (const auto& view : done_.views)
    for (const Eigen::Vector3d& point : calibration::boardPoints(kBoard)) {
      const Eigen::Vector3d in_left = view.T_left_board * point;
      worst = std::max(worst, epipolarError(done_.rig, truth_.left.project(in_left),
                                            truth_.right.project(truth_.T_right_left * in_left)));
    }
  std::printf("worst epipolar error of true corners %.3f px\n", worst);
  EXPECT_LT(worst, 0.1);
}

TEST_F(RenderedBoards, OtherBoardsTriangulateToTwoCentimetresAtTwoMetres) {
  topside::BoardImages images = boardsIn(folder_->path() / "other");
  (void)calibration::alignBoards(done_.rig.left, done_.rig.right, kBoard, images.views);
  const calibration::BoardCheck check = calibration::checkBoards(done_.rig, kBoard, images.views);
  ASSERT_EQ(check.boards.size(), 6u);
  for (const calibration::BoardError& board : check.boards) {
    constexpr double kAllowed = 0.02, kAt = 2.0;  // [m]: the reference's
    EXPECT_LT(board.max_z, kAllowed * std::pow(board.range / kAt, 2)) << board.name << " at " << board.range;
  }
  EXPECT_NEAR(check.scale, 1.0, 0.002);
  const topside::BoardVerdict verdict = topside::judge(check);
  EXPECT_TRUE(verdict.good);
  const auto out = folder_->path() / "check";
  std::filesystem::create_directories(out);
  topside::writeBoardCheck(out, check, verdict, images.dropped);
  for (const char* name : {"board-check.html", "board-check.json"})
    EXPECT_GT(std::filesystem::file_size(out / name), 1000u) << name;
}

TEST_F(RenderedBoards, ARightCameraTurnedByATenthOfADegreeIsDetected) {
  topside::BoardImages images = boardsIn(folder_->path() / "other");
  StereoRig turned = done_.rig;
  turned.T_right_left = SE3::fromEuler(0, degreesToRadians(0.1), 0, {0, 0, 0}) * turned.T_right_left;
  (void)calibration::alignBoards(turned.left, turned.right, kBoard, images.views);
  const topside::BoardVerdict verdict =
      topside::judge(calibration::checkBoards(turned, kBoard, images.views));
  EXPECT_FALSE(verdict.good);
}

// The same boards through flat ports, which a calibration in water without them cannot follow to every depth.
TEST(BoardsBehindPorts, GiveThePortsOfCamerasCalibratedInAir) {
  const test::TemporaryFolder folder;
  sim::Scenario scenario;
  scenario.scale = 0.5;
  for (Camera* camera : {&scenario.rig.left, &scenario.rig.right}) {
    camera->fx *= 0.75, camera->fy *= 0.75;
    camera->k1 = -0.11, camera->k2 = 0.09, camera->p1 = 4e-4, camera->p2 = -3e-4;
  }
  scenario.ports = {sim::PortKind::kFlat,
                    {.normal = {0.012, -0.017, 1}, .distance = 0.035, .glass = 0.012},
                    {.normal = {-0.009, 0.008, 1}, .distance = 0.028, .glass = 0.012}};
  const auto render = [&](const char* name, int views, std::uint64_t seed, double distance) {
    sim::BoardMakerOptions options;
    options.board = kBoard;
    options.poses.views = views;
    options.poses.seed = seed;
    options.poses.distance = distance;
    options.out = folder.path() / name;
    sim::makeBoards(scenario, options);
  };
  render("near", 10, 1, 1.3);
  render("far", 10, 2, 2.4);
  render("other", 6, 3, 1.4);
  const StereoRig truth = readStereoCalib(folder.path() / "near" / "truth" / "stereo.calib");
  ASSERT_TRUE(truth.left.port);
  StereoRig air = truth;
  air.left = truth.left.port->air, air.right = truth.right.port->air;
  writeStereoCalib(folder.path() / "air.calib", air);

  topside::CalibrateOptions options;
  options.board = {"9x6", kBoard.square, {}};
  options.board.images.images = {folder.path() / "near" / "img", folder.path() / "far" / "img"};
  options.out = folder.path() / "pinhole.calib";
  const StereoRig pinhole = topside::runCalibrate(options).rig;
  options.out = folder.path() / "stereo.calib";
  options.air = folder.path() / "air.calib";
  options.glass.thickness = 0.012;
  const calibration::RigCalibration done = topside::runCalibrate(options);
  const auto show = [](const char* side, const FlatPort& port, const calibration::PortSigma& sigma,
                       const FlatPort& true_port) {
    std::printf("%s port: %.2f +- %.2f mm (true %.2f), normal %.4f %.4f +- %.4f (true %.4f %.4f)\n", side,
                1e3 * port.distance, 1e3 * sigma.distance, 1e3 * true_port.distance, port.normal.x(),
                port.normal.y(), sigma.normal.x(), true_port.normal.x(), true_port.normal.y());
    EXPECT_NEAR(port.distance, true_port.distance, 3 * sigma.distance + 0.001);
    EXPECT_LT(sigma.distance, 0.006);
  };
  show("left", *done.rig.left.port, done.sigma.left_port, *truth.left.port);
  show("right", *done.rig.right.port, done.sigma.right_port, *truth.right.port);
  std::printf("stereo RMS %.3f px, baseline %.3f mm (true %.3f)\n", done.stereo_rms,
              1e3 * done.rig.baseline(), 1e3 * truth.baseline());
  const StereoRig written = readStereoCalib(options.out);
  ASSERT_TRUE(written.left.port);

  // Points nearer and farther than most corners of the boards: by both rigs, from true pixels.
  const auto worst = [&](const StereoRig& rig) {
    double out = 0;
    for (const double z : {0.8, 1.2, 2.0, 3.2})
      for (const double x : {-0.25, 0.0, 0.25})
        for (const double y : {-0.2, 0.0, 0.2}) {
          const Eigen::Vector3d p = z * Eigen::Vector3d(x, y, 1);
          Eigen::Vector3d found;
          double gap = 0;
          EXPECT_TRUE(triangulatePixels(rig, truth.left.project(p),
                                        truth.right.project(truth.T_right_left * p), found, gap));
          out = std::max(out, std::abs(found.z() / p.z() - 1) / z);
        }
    return out;
  };
  const double by_ports = worst(written), by_pinhole = worst(pinhole);
  std::printf("worst depth error, of the depth and per metre of it: %.2f %% by ports, %.2f %% by a pinhole\n",
              100 * by_ports, 100 * by_pinhole);
  EXPECT_LT(by_ports, 0.0026);
  EXPECT_GT(by_pinhole, 0.01);
}

TEST(BoardMaker, TheSameSeedGivesTheSameBytes) {
  const test::TemporaryFolder folder;
  renderBoards(folder.path() / "a", 1, 3);
  renderBoards(folder.path() / "b", 1, 3);
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path() / "a")) {
    if (!entry.is_regular_file()) continue;
    const auto other = folder.path() / "b" / entry.path().lexically_relative(folder.path() / "a");
    EXPECT_EQ(test::readText(entry.path()), test::readText(other)) << other;
  }
}

TEST(BoardMaker, ABoardThatDoesNotFitIsRefused) {
  const test::TemporaryFolder folder;
  sim::BoardMakerOptions options;
  options.board = {9, 6, 0.3};
  options.out = folder.path() / "out";
  EXPECT_THROW(sim::makeBoards(sim::Scenario(), options), InputError);
  EXPECT_FALSE(std::filesystem::exists(options.out));
}

}  // namespace
}  // namespace fathom

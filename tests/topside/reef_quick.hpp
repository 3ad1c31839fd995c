#pragma once

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "firmware_if/mission/pose_files.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/topside/pipeline.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::topside {

// Simulated dive at a quarter of the image scale, rendered once by the fixture in CMakeLists.txt.
inline const std::filesystem::path kReefMission = FATHOM_REEF_MISSION;

class ReefQuick : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    ASSERT_TRUE(std::filesystem::exists(kReefMission / "mission.toml")) << "the mission was not rendered";
    out_ = std::make_unique<test::TemporaryFolder>();
    done_ = runTopside(kReefMission, out_->path() / "topside", {});
    // The same as a diver's stereo camera leaves it: folders of numbered PNG images.
    for (const char* side : {"left", "right"}) std::filesystem::create_directories(dive() / side);
    std::filesystem::copy(kReefMission / "stereo.calib", dive() / "stereo.calib");
    poses_ = io::readStereoPoses(out_->path() / "topside" / "stereo_pose_est.data");
    for (std::size_t k = 0; k < poses_.poses.size(); ++k)
      for (const auto& [side, name] : {std::pair("left/", &poses_.poses[k].left_image),
                                       std::pair("right/", &poses_.poses[k].right_image)}) {
        const std::string numbered = side + std::to_string(k) + ".png";
        const cv::Mat image = cv::imread((kReefMission / "img" / *name).string(), cv::IMREAD_UNCHANGED);
        cv::imwrite((dive() / numbered).string(), image);
        *name = numbered;
      }
  }
  static void TearDownTestSuite() { out_.reset(); }

  static RunPlaces run() {
    return {kReefMission, out_->path() / "topside.work", out_->path() / "topside", {}};
  }
  static std::filesystem::path dive() { return out_->path() / "dive"; }
  static RunPlaces placesOf(const std::string& name) {
    RunPlaces places{dive(), out_->path() / (name + ".work"), out_->path() / name, {}};
    places.input.left_format = "bayer-rggb";
    return places;
  }

  inline static std::unique_ptr<test::TemporaryFolder> out_;
  inline static Summary done_;
  inline static io::StereoPoseFile poses_;  // of the run with navigation, by the numbered names
};

inline SE3 truePoseAt(const std::vector<io::TrajectoryPoint>& truth, double utc_s) {
  const auto utc_ns = static_cast<std::int64_t>(utc_s * 1e9);
  const auto after =
      std::lower_bound(truth.begin() + 1, truth.end() - 1, utc_ns,
                       [](const io::TrajectoryPoint& p, std::int64_t t) { return p.utc_ns < t; });
  const auto before = after - 1;
  return interpolate(
      before->pose, after->pose,
      static_cast<double>(utc_ns - before->utc_ns) / static_cast<double>(after->utc_ns - before->utc_ns));
}

// The dive as a whole is as far off as its fixes: the shift that takes this out [m]. Expects what is left of
// every pose to be below `limit` [m].
inline Eigen::Vector3d shiftToTruth(const std::filesystem::path& mission,
                                    const std::filesystem::path& topside, std::size_t pairs, double limit) {
  const auto truth = io::readTrajectory(mission / "truth" / "trajectory.csv");
  const auto poses = io::readVehiclePoses(topside / "vehicle_pose_est.data").poses;
  EXPECT_EQ(poses.size(), pairs);
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  for (const auto& p : poses)
    shift += (truePoseAt(truth, p.utc_s).translation() - p.T_nav_body.translation()) /
             static_cast<double>(poses.size());
  EXPECT_LT(shift.head<2>().norm(), 4.0);
  EXPECT_LT(std::abs(shift.z()), 0.05);
  for (const auto& p : poses)
    EXPECT_LT((p.T_nav_body.translation() + shift - truePoseAt(truth, p.utc_s).translation()).norm(), limit)
        << p.id;
  return shift;
}

// Rms difference of two models' colours at vertices in the same squares of 2 cm [grey levels].
inline double colourDifference(const Mesh& a, const Mesh& b) {
  const auto square = [](const Eigen::Vector3f& p) {
    return std::array{static_cast<int>(std::floor(50 * p.x())), static_cast<int>(std::floor(50 * p.y()))};
  };
  std::map<std::array<int, 2>, std::size_t> by_square;
  for (std::size_t k = 0; k < a.vertices.size(); ++k) by_square[square(a.vertices[k])] = k;
  double squares = 0, count = 0;
  for (std::size_t k = 0; k < b.vertices.size(); ++k) {
    const auto same = by_square.find(square(b.vertices[k]));
    if (same == by_square.end()) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const double d = static_cast<double>(b.colours[k][c]) - a.colours[same->second][c];
      squares += d * d;
      count += 1;
    }
  }
  return std::sqrt(squares / count);
}

// Mean difference of a vertex's red, green and blue from their mean [grey levels].
inline double chromaOf(const Mesh& mesh) {
  double sum = 0;
  for (const Rgb& c : mesh.colours) {
    const double mean = (c[0] + c[1] + c[2]) / 3.0;
    sum += (std::abs(c[0] - mean) + std::abs(c[1] - mean) + std::abs(c[2] - mean)) / 3;
  }
  return sum / static_cast<double>(mesh.colours.size());
}

// Correlation of how much redder than blue two models are, by squares of 10 cm; 0 where one has no colours.
inline double hueCorrelation(const Mesh& a, const Mesh& b) {
  struct Sums {
    std::array<double, 2> redder{}, count{};
  };
  std::map<std::array<int, 2>, Sums> by_square;
  for (const std::size_t side : {0U, 1U}) {
    const Mesh& mesh = side == 0 ? a : b;
    for (std::size_t k = 0; k < mesh.vertices.size(); ++k) {
      const Eigen::Vector3f& p = mesh.vertices[k];
      Sums& sums =
          by_square[{static_cast<int>(std::floor(10 * p.x())), static_cast<int>(std::floor(10 * p.y()))}];
      sums.redder[side] += mesh.colours[k][0] - mesh.colours[k][2];
      sums.count[side] += 1;
    }
  }
  double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  for (const auto& [square, sums] : by_square) {
    constexpr double kEnough = 8;  // vertices
    if (sums.count[0] < kEnough || sums.count[1] < kEnough) continue;
    const double u = sums.redder[0] / sums.count[0], v = sums.redder[1] / sums.count[1];
    n += 1, x += u, y += v, xx += u * u, yy += v * v, xy += u * v;
  }
  const double spread = (xx - x * x / n) * (yy - y * y / n);
  return spread > 0 ? (xy - x * y / n) / std::sqrt(spread) : 0;
}

}  // namespace fathom::topside

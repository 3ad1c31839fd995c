#include "recon/topside/calibration/mission_check.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/hash64.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/calibration/free_matches.hpp"
#include "recon/topside/commands/commands.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/rigs.hpp"

namespace fathom::topside {
namespace {

using Kind = MissionVerdict::Line::Kind;

// A simulated dive at a quarter of the image scale, rendered once by the fixture of tests/topside; its rig is
// the true one.
const std::filesystem::path kMission = FATHOM_REEF_MISSION;

// The same dive with another calibration or mission.toml.
class Altered {
 public:
  Altered() {
    for (const char* name : {"img", "sensors.lcmlog"})
      std::filesystem::create_symlink(kMission / name, path() / name);
    std::filesystem::copy(kMission / "mission.toml", path());
    std::filesystem::copy(kMission / "stereo.calib", path());
  }
  template <typename Change>
  void rig(const Change& change) {
    StereoRig rig = readStereoCalib(path() / "stereo.calib");
    change(rig);
    writeStereoCalib(path() / "stereo.calib", rig);
  }
  // The right camera by three tenths of a degree.
  void pitchRight() {
    rig([](StereoRig& rig) {
      rig.T_right_left = SE3::fromEuler(0.3 * kRadiansPerDegree, 0, 0, {0, 0, 0}) * rig.T_right_left;
    });
  }
  template <typename Change>
  void config(const Change& change) {
    io::MissionConfig config = io::readMissionConfig(path());
    change(config);
    io::writeMissionConfig(path(), config);
  }
  [[nodiscard]] const std::filesystem::path& path() const { return folder_.path(); }

 private:
  test::TemporaryFolder folder_;
};

bool isBad(const MissionVerdict& verdict, const std::string& about) {
  for (const auto& line : verdict.lines)
    if (line.kind == Kind::kBad && line.text.find(about) != std::string::npos) return true;
  return false;
}

std::string textOf(const MissionVerdict& verdict) {
  std::string text;
  for (const auto& line : verdict.lines) text += std::string(nameOf(line.kind)) + ": " + line.text + "\n";
  return text;
}

// Flat ground of little contrast 2 m below, and a speck of marine snow before it that the strobes saturate.
std::vector<std::uint8_t> dimGroundBehindSnow(const Camera& camera, const SE3& T_cam_left) {
  constexpr double kGround = 2, kCell = 0.012, kLevel = 90, kContrast = 8, kSaturated = 255;
  const auto at = [](std::int64_t i, std::int64_t j) {
    return static_cast<double>(hash64(static_cast<std::uint64_t>(i * 100003 + j)) >> 40) / (1 << 24) - 0.5;
  };
  const SE3 T_left_cam = T_cam_left.inverse();
  const Eigen::Vector2d speck = camera.project(T_cam_left * Eigen::Vector3d(0.1, 0.1, 1));
  std::vector<std::uint8_t> image;
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Eigen::Vector3d ray = T_left_cam.rotation() * camera.ray({x, y});
      const Eigen::Vector3d from = T_left_cam.translation();
      const Eigen::Vector3d place = (from + (kGround - from.z()) / ray.z() * ray) / kCell;
      const auto i = static_cast<std::int64_t>(std::floor(place.x())),
                 j = static_cast<std::int64_t>(std::floor(place.y()));
      const double u = place.x() - std::floor(place.x()), v = place.y() - std::floor(place.y());
      const double ground = (1 - v) * ((1 - u) * at(i, j) + u * at(i + 1, j)) +
                            v * ((1 - u) * at(i, j + 1) + u * at(i + 1, j + 1));
      const bool snow = (Eigen::Vector2d(x, y) - speck).norm() < 2;
      image.push_back(static_cast<std::uint8_t>(snow ? kSaturated : kLevel + kContrast * ground));
    }
  return image;
}

TEST(FreeMatches, ASpeckThatOutshinesTheGroundDoesNotHideIt) {
  const StereoRig rig = test::smallRig();
  const auto left = dimGroundBehindSnow(rig.left, SE3()),
             right = dimGroundBehindSnow(rig.right, rig.T_right_left);
  const auto viewOf = [](const std::vector<std::uint8_t>& image, const Camera& camera) {
    return ImageView{image.data(),       camera.width,
                     camera.height,      static_cast<std::size_t>(camera.width),
                     PixelFormat::kMono, 8};
  };
  const auto matches = matchFreely(rig, viewOf(left, rig.left), viewOf(right, rig.right), {});
  std::vector<double> off;
  for (const RigMatch& match : matches) off.push_back(std::abs(calibration::epipolarError(rig, match)));
  std::sort(off.begin(), off.end());
  ASSERT_GT(matches.size(), 300u);
  std::printf("%zu matches, median %.3f px off\n", matches.size(), off[off.size() / 2]);
  EXPECT_LT(off[off.size() / 2], 0.04);
}

TEST(MissionCheck, TheRigAsItIsPasses) {
  ASSERT_TRUE(std::filesystem::exists(kMission / "mission.toml")) << "the mission was not rendered";
  const MissionCheck check = checkMission({kMission, {}, 200});
  const MissionVerdict verdict = judge(check);
  std::printf("%s", textOf(verdict).c_str());
  EXPECT_TRUE(verdict.good);
  EXPECT_EQ(check.pairs, 30u);
  EXPECT_LT(std::abs(check.epipolar.median), 0.1);
  EXPECT_NEAR(check.range.ratio, 1.0, 0.03);
  for (int i = 0; i < 3; ++i)
    EXPECT_LT(std::abs(check.mount.both.rotation(i)), 0.3 * kRadiansPerDegree + 3 * check.mount.both.sigma(i))
        << i;

  const test::TemporaryFolder out;
  writeMissionCheck(out.path(), check, verdict);
  std::ifstream file(out.path() / "mission-check.json");
  const auto json = nlohmann::json::parse(file);
  EXPECT_TRUE(json["good"].get<bool>());
  EXPECT_EQ(json["pairs"].get<int>(), 30);
  EXPECT_EQ(json["epipolar"]["cells"].size(), 48u);
  EXPECT_GT(std::filesystem::file_size(out.path() / "mission-check.html"), 10000u);
}

TEST(MissionCheck, TheSameMissionGivesTheSameNumbers) {
  const MissionCheck one = checkMission({kMission, {}, 24}), two = checkMission({kMission, {}, 24});
  EXPECT_EQ(one.matches, two.matches);
  EXPECT_EQ(one.epipolar.median, two.epipolar.median);
  EXPECT_EQ(one.range.ratio, two.range.ratio);
  EXPECT_EQ(one.mount.both.rotation, two.mount.both.rotation);
}

TEST(MissionCheck, ARightCameraPitchedByThreeTenthsOfADegreeIsNoticedAndMeasured) {
  Altered mission;
  mission.pitchRight();
  const MissionCheck check = checkMission({mission.path(), {}, 200});
  const MissionVerdict verdict = judge(check);
  EXPECT_FALSE(verdict.good);
  EXPECT_TRUE(isBad(verdict, "the rig has moved")) << textOf(verdict);
  EXPECT_NEAR(check.epipolar.change.rotation.x() / kRadiansPerDegree, -0.3,
              0.02);  // back to where it truly stands
  EXPECT_NEAR(check.epipolar.change.rotation.z() / kRadiansPerDegree, 0, 0.05);
}

TEST(MissionCheck, AFocalLengthFivePerCentTooLongIsNoticedAndMeasured) {
  Altered mission;
  mission.rig([](StereoRig& rig) {
    for (Camera* camera : {&rig.left, &rig.right}) camera->fx *= 1.05, camera->fy *= 1.05;
  });
  const MissionCheck check = checkMission({mission.path(), {}, 200});
  const MissionVerdict verdict = judge(check);
  EXPECT_FALSE(verdict.good);
  EXPECT_TRUE(isBad(verdict, "stereo range")) << textOf(verdict);
  EXPECT_NEAR(check.range.ratio, 1.05, 0.025);
}

TEST(MissionCheck, ACalibrationInAirBehindAFlatPortIsNamed) {
  Altered mission;
  mission.rig([](StereoRig& rig) {
    for (Camera* camera : {&rig.left, &rig.right}) camera->fx /= 1.33, camera->fy /= 1.33;
  });
  const MissionCheck check = checkMission({mission.path(), {}, 200});
  const MissionVerdict verdict = judge(check);
  EXPECT_TRUE(isBad(verdict, "flat port")) << textOf(verdict);
  EXPECT_NEAR(check.range.ratio, 1 / 1.33, 0.04);
}

TEST(MissionCheck, ACameraMountedThreeDegreesOffIsNoticedAboutEachAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    Altered mission;
    Vector6d twist = Vector6d::Zero();
    twist(3 + axis) = 3 * kRadiansPerDegree;
    mission.config([&](io::MissionConfig& config) {
      config.T_body_cam =
          SE3(SE3::exp(twist).rotation() * config.T_body_cam.rotation(), config.T_body_cam.translation());
    });
    const MissionCheck check = checkMission({mission.path(), {}, 200});
    const MissionVerdict verdict = judge(check);
    EXPECT_TRUE(isBad(verdict, axis == 0   ? "camera's roll"
                               : axis == 1 ? "camera's pitch"
                                           : "camera's yaw"))
        << textOf(verdict);
    for (int i = 0; i < 3; ++i)
      EXPECT_NEAR(check.mount.both.rotation(i) / kRadiansPerDegree, i == axis ? -3 : 0, 1.0)
          << "mounted off about " << axis;
  }
}

// The exit code as a shell script gets it.
int exitCodeOf(std::vector<std::string> arguments) {
  CommandLine app("");
  addCheckCalibrationCommand(app);
  arguments.insert(arguments.begin(), {"fathom-topside", "check-calibration"});
  std::vector<char*> words;
  for (std::string& argument : arguments) words.push_back(argument.data());
  return app.run("fathom-topside", static_cast<int>(words.size()), words.data());
}

TEST(MissionCheck, TheCommandExitsWithZeroForAGoodRigAndWithOneForABadOne) {
  Altered mission;
  mission.pitchRight();
  const test::TemporaryFolder out;
  EXPECT_EQ(exitCodeOf({kMission.string(), "--out", (out.path() / "good").string()}), 0);
  EXPECT_EQ(exitCodeOf({mission.path().string(), "--pairs", "12"}), 1);
  EXPECT_TRUE(std::filesystem::exists(out.path() / "good" / "mission-check.html"));
}

TEST(MissionCheck, ACalibrationOfAnotherImageSizeIsRefusedWithBothSizes) {
  Altered mission;
  mission.rig([](StereoRig& rig) { rig = rig.scaled(2); });
  EXPECT_THAT(test::refusal([&] {
                (void)checkMission({mission.path(), {}, 12});
              }),
              testing::HasSubstr("where the calibration says"));
}

TEST(MissionCheck, AnotherMissionsCalibrationCanBeTried) {
  Altered mission;
  mission.pitchRight();
  EXPECT_FALSE(judge(checkMission({kMission, mission.path() / "stereo.calib", 12})).good);
}

TEST(MissionCheck, AFolderThatIsNoMissionIsRefused) {
  const test::TemporaryFolder folder;
  EXPECT_THROW((void)checkMission({folder.path(), {}, 200}), InputError);
}

}  // namespace
}  // namespace fathom::topside

// A dive whose images show the vehicle's own frame, hidden by masks.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <random>

#include "recon/geometry/ply_reader.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/reef_quick.hpp"
#include "tests/topside/same_colours.hpp"
#include "tests/topside/true_shift.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr;

// A bar along one side and a foot in a corner; 0 hides.
cv::Mat frameOf(const cv::Size& size, CameraSide side) {
  cv::Mat shown(size, CV_8U, cv::Scalar(255));
  const int shift = side == CameraSide::kLeft ? 0 : size.width / 20;
  cv::rectangle(shown, {shift, 0}, {shift + size.width / 7, size.height}, 0, cv::FILLED);
  cv::circle(shown, {size.width, size.height}, size.height / 4 + shift, 0, cv::FILLED);
  return shown;
}

// The frame is red and speckled, and stands still in all images of a camera.
void drawFrame(cv::Mat& image, const cv::Mat& shown) {
  std::mt19937 random(3);
  std::uniform_int_distribution<int> speckle(0, 3);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) {
      const int grain = speckle(random);
      if (shown.at<std::uint8_t>(y, x) != 0) continue;
      const bool red = x % 2 == 0 && y % 2 == 0;
      image.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>((red ? 2000 : 200) / (1 + grain));
    }
}

class FramedDive : public ReefQuick {
 protected:
  static std::filesystem::path framed() { return out_->path() / "framed"; }
  static void SetUpTestSuite() {
    ReefQuick::SetUpTestSuite();
    std::filesystem::create_directories(framed() / "img");
    for (const char* name : {"mission.toml", "sensors.lcmlog", "stereo.calib"})
      std::filesystem::create_symlink(kReefMission / name, framed() / name);
    for (const auto& entry : std::filesystem::directory_iterator(kReefMission / "img")) {
      const std::string name = entry.path().filename().string();
      const auto parsed = io::parseImageFileName(name);
      cv::Mat image = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
      drawFrame(image, frameOf(image.size(), parsed->side));
      cv::imwrite((framed() / "img" / name).string(), image);
    }
  }
  static RunPlaces placesOf(const std::string& name) {
    return {framed(), out_->path() / (name + ".work"), out_->path() / name, {}};
  }
  static std::filesystem::path maskFile(const std::string& name, CameraSide side) {
    const std::filesystem::path file = out_->path() / name;
    std::filesystem::create_directories(file.parent_path());
    const StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
    cv::imwrite(file.string(), frameOf({rig.left.width, rig.left.height}, side));
    return file;
  }

  struct Model {
    Summary summary;
    double surface = 0;  // 95 % of its vertices are nearer to the true seafloor [m]
    double colour = 0;   // rms difference from the dive without a frame [grey levels]
  };
  static Model modelOf(const RunPlaces& places) {
    Model out;
    out.summary = runTopside(places, {});
    const Eigen::Vector3f shift =
        shiftToTruth(kReefMission, places.out, out.summary.pairs, 0.3).cast<float>();
    const Mesh seafloor = readPly(kReefMission / "truth" / "terrain.ply");
    const test::SurfaceDistance to_seafloor(seafloor, 0.25F);
    const Mesh clean = readPly(out_->path() / "topside" / "mesh.ply"),
               mesh = readPly(places.out / "mesh.ply");
    std::vector<float> distances;
    for (const Eigen::Vector3f& v : mesh.vertices) distances.push_back(to_seafloor(v + shift));
    std::sort(distances.begin(), distances.end());
    out.surface = static_cast<double>(distances[distances.size() * 95 / 100]);
    out.colour = colourDifference(clean, mesh);
    return out;
  }
};

TEST_F(FramedDive, HiddenPartsOfTheVehicleLeaveNoTrace) {
  RunPlaces seen = placesOf("seen"), hidden = placesOf("hidden");
  hidden.input.masks = maskFile("masks/left.png", CameraSide::kLeft).parent_path();
  (void)maskFile("masks/right.png", CameraSide::kRight);
  const Model clean = modelOf(run()), with = modelOf(seen), without = modelOf(hidden);
  for (const auto& [name, model] : {std::pair("seen", &with), std::pair("hidden", &without)})
    std::printf("%s: colours %.1f off, surface %.1f mm (%.1f), area %.1f m2 (%.1f)\n", name, model->colour,
                1e3 * model->surface, 1e3 * clean.surface, model->summary.area, done_.area);
  EXPECT_EQ(without.summary.used, done_.used);
  EXPECT_LT(without.colour, 0.6 * with.colour);
  EXPECT_LT(without.surface, 1.15 * clean.surface);
  EXPECT_GT(without.summary.area, with.summary.area);
}

// By image, named as other programs do, on top of the same for all images of a camera.
TEST_F(FramedDive, MasksOfSingleImagesAreFoundByTheirNames) {
  const StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
  const std::filesystem::path folder = maskFile("single/right.png", CameraSide::kRight).parent_path();
  for (const char* name : {"single/left/0.png.png", "single/left/1_mask.png", "single/left/2.png"})
    (void)maskFile(name, CameraSide::kLeft);
  (void)maskFile("single/right/1.png", CameraSide::kLeft);
  const ImageMasks masks(folder, {rig.left, rig.right});
  const cv::Mat shown = frameOf({rig.left.width, rig.left.height}, CameraSide::kLeft),
                right = frameOf({rig.left.width, rig.left.height}, CameraSide::kRight);
  for (const char* image : {"left/0.png", "left/1.tif", "left/2.jpg"}) {
    const auto mask = masks.of(image, 0);
    ASSERT_TRUE(mask) << image;
    for (int y = 0; y < shown.rows; y += 5)
      for (int x = 0; x < shown.cols; x += 5)
        EXPECT_EQ(mask->hides({x, y}), shown.at<std::uint8_t>(y, x) == 0) << image;
  }
  EXPECT_FALSE(masks.of("left/3.png", 0));
  const auto both = masks.of("right/1.png", 1);
  for (int x = 0; x < shown.cols; ++x)
    EXPECT_EQ(both->hides({x, 9}), shown.at<std::uint8_t>(9, x) == 0 || right.at<std::uint8_t>(9, x) == 0);
}

TEST_F(FramedDive, MasksThatCannotBeMeantAreRefusedByName) {
  const auto why = [&](const std::filesystem::path& masks) {
    RunPlaces places = placesOf("refused");
    places.input.masks = masks;
    return test::refusal([&] { (void)runTopside(places, {}); });
  };
  const StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
  const std::filesystem::path out = out_->path();
  std::filesystem::create_directories(out / "none");
  cv::imwrite((out / "black.png").string(), cv::Mat(rig.left.height, rig.left.width, CV_8U, cv::Scalar(0)));
  cv::imwrite((out / "large.png").string(), cv::Mat(rig.left.height, 900, CV_8U, cv::Scalar(255)));
  EXPECT_THAT(why(out / "absent.png"), HasSubstr("is not there"));
  EXPECT_THAT(why(out / "none"), HasSubstr("NAME_mask.png for the image NAME"));
  EXPECT_THAT(why(out / "black.png"), HasSubstr("hides the whole image"));
  EXPECT_THAT(why(out / "large.png"), HasSubstr("a mask has the size of its image"));
  (void)maskFile("others/IMG_0001_mask.png", CameraSide::kLeft);
  EXPECT_THAT(why(out / "others"), HasSubstr("none of its 1 masks is of an image of the dive"));
}

}  // namespace
}  // namespace fathom::topside

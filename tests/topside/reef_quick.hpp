#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <opencv2/imgcodecs.hpp>

#include "firmware_if/mission/pose_files.hpp"
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

}  // namespace fathom::topside

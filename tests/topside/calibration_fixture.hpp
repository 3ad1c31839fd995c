#pragma once

#include <gmock/gmock.h>

#include "recon/import/calibration/calibration.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/calibration_files.hpp"

namespace fathom::topside {

constexpr double kMost = 1e-12;  // of relative error: all formats carry 17 digits

class CalibrationFiles : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& text) {
    test::writeText(folder_.path() / name, text);
    return folder_.path() / name;
  }
  [[nodiscard]] std::filesystem::path at(const char* name) const { return folder_.path() / name; }
  static void expectRig(const StereoRig& rig, const StereoRig& expected) {
    for (const auto& [read, truth] :
         {std::pair(&rig.left, &expected.left), std::pair(&rig.right, &expected.right)}) {
      EXPECT_EQ(read->width, truth->width);
      EXPECT_EQ(read->height, truth->height);
      for (const auto number : {&Camera::fx, &Camera::fy, &Camera::cx, &Camera::cy, &Camera::k1, &Camera::k2,
                                &Camera::p1, &Camera::p2, &Camera::k3})
        EXPECT_NEAR(read->*number, truth->*number, kMost * std::abs(truth->*number));
    }
    EXPECT_LT((rig.T_right_left.inverse() * expected.T_right_left).log().norm(), kMost);
  }
  // Reads the file and compares all parameters.
  static std::string readsAs(const std::filesystem::path& path, const StereoRig& expected,
                             std::optional<double> unit = {}) {
    const Calibration read = readCalibration(path, unit);
    expectRig(read.rig, expected);
    return read.about;
  }
  static std::string refusal(const std::filesystem::path& path) {
    return test::refusal([&] { (void)readCalibration(path); });
  }
  std::string refusal(const std::string& name, const std::string& text) { return refusal(write(name, text)); }
  std::string refusalOfFolder() {
    return test::refusal([&] { (void)findCalibration(folder_.path()); });
  }

  test::TemporaryFolder folder_;
  StereoRig rig_ = test::divingRig();
};

inline StereoRig withoutK3(StereoRig rig) {
  rig.left.k3 = rig.right.k3 = 0;
  return rig;
}

}  // namespace fathom::topside

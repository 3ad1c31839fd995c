// Extrinsics and clocks that differ from the files.
#include "recon/navigation/sensors/mounting_check.hpp"

#include <gtest/gtest.h>

#include "tests/navigation/synthetic_dive.hpp"

namespace fathom::slam {
namespace {

using testing::SyntheticDive;
using testing::SyntheticDiveOptions;

SyntheticDive surveyed(std::uint64_t seed) {
  SyntheticDiveOptions options;
  options.seed = seed;
  options.lines = 8;
  options.interval = 0.4;
  options.false_links = 5;
  return testing::makeDive(options);
}

// Dead reckoning of a camera that is turned and whose images were taken later than they say.
std::vector<KeyframeInput> withWrongMounting(const SyntheticDive& survey, const Eigen::Vector3d& turn,
                                             double offset) {
  Vector6d twist;
  twist << Eigen::Vector3d::Zero(), turn;
  const SE3 turned = SE3::exp(-twist);
  std::vector<KeyframeInput> frames = survey.inputs;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    SE3 T = survey.inputs[k].T_odom_cam;
    if (k > 0) {
      const KeyframeInput &before = survey.inputs[k - 1], &here = survey.inputs[k];
      const double share = 1 - offset / (static_cast<double>(here.utc_ns - before.utc_ns) * 1e-9);
      T = interpolate(before.T_odom_cam, T, share);
    }
    frames[k].T_odom_cam = T * turned;
  }
  return frames;
}

TEST(Mounting, OfATurnedCameraAndALateClockIsFoundWithinItsClaim) {
  const Eigen::Vector3d turn(0.02, -0.015, 0.03);
  const double offset = 0.08;
  constexpr int kSeeds = 20;
  Eigen::Matrix<double, 5, 1> squares = Eigen::Matrix<double, 5, 1>::Zero();
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const SyntheticDive survey = surveyed(seed);
    const auto links = measuredOf(survey, 1).links;
    const Mounting found = mountingOf(withWrongMounting(survey, turn, offset), links, {});
    // What attitude sensor and DVL are turned by, the camera is turned against them.
    const Eigen::Vector3d known =
        turn - Eigen::Vector3d(survey.tilt_bias.x(), survey.tilt_bias.y(), survey.dvl_heading);
    squares.head<3>() += (found.camera_turn - known).cwiseQuotient(found.camera_turn_sigma).cwiseAbs2();
    squares(3) += std::pow((found.dvl_scale + survey.dvl_scale) / found.dvl_scale_sigma, 2);
    squares(4) += std::pow((found.time_offset - offset) / found.time_offset_sigma, 2);
    EXPECT_LT(found.camera_turn_sigma.maxCoeff(), 0.01);
    EXPECT_LT(found.time_offset_sigma, 0.03);
  }
  // 99 % of chi-square with 20 degrees of freedom.
  for (int i = 0; i < 5; ++i) {
    EXPECT_GT(squares(i), 7.4) << i;
    EXPECT_LT(squares(i), 40.0) << i;
  }
}

}  // namespace
}  // namespace fathom::slam

#include "tests/onboard/live/played_devices.hpp"

#include <gtest/gtest.h>

namespace fathom::test {
namespace {

// Three pairs half a second apart with a DVL sample beside each, which arrives 30 ms late.
std::vector<io::OnboardInput> survey() {
  std::vector<io::OnboardInput> inputs;
  constexpr std::int64_t kBegin = 1'000'000'000'000, kApart = 500'000'000, kLate = 30'000'000;
  for (int i = 0; i < 5; ++i) {
    const std::int64_t utc = kBegin + i * kApart;
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight})
      inputs.push_back({utc, SensorSample(ImageEvent{utc, side, "image" + std::to_string(i), 0.001})});
    DvlSample dvl{.utc_ns = utc, .velocity = Eigen::Vector3d(1.0 + i, 0, 0), .range = {}, .altitude = {}};
    inputs.push_back({utc + kLate, SensorSample(dvl)});
  }
  return inputs;
}

TEST(Shuttle, FliesTheFirstPairsForwardAndBackWithoutEnd) {
  const Shuttle shuttle(survey(), 3);
  std::vector<std::string> left;
  std::vector<double> velocity;
  std::int64_t last_arrival = 0, last_image = -1;
  for (std::uint64_t i = 0; i < 3 * shuttle.stepsOfLeg(); ++i) {
    const Shuttle::Step step = shuttle.at(i);
    EXPECT_GE(step.arrival_ns, last_arrival);
    last_arrival = step.arrival_ns;
    if (const auto* image = std::get_if<ImageEvent>(&step.sample);
        image && image->side == CameraSide::kLeft) {
      EXPECT_GT(image->utc_ns, last_image);
      last_image = image->utc_ns;
      left.push_back(image->file_name);
    }
    if (const auto* dvl = std::get_if<DvlSample>(&step.sample)) {
      EXPECT_LE(dvl->utc_ns, step.arrival_ns);
      velocity.push_back(dvl->velocity->x());
    }
  }
  EXPECT_EQ(left, (std::vector<std::string>{"image0", "image1", "image2", "image2", "image1", "image0",
                                            "image0", "image1", "image2"}));
  EXPECT_EQ(velocity, (std::vector<double>{1, 2, 3, -3, -2, -1, 1, 2, 3}));
}

}  // namespace
}  // namespace fathom::test

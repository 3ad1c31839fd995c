#include "realtime/onboard/nav/nav_input.hpp"

#include <gtest/gtest.h>

namespace fathom::onboard {
namespace {

TEST(NavInput, CarriesAFullEnsemble) {
  DvlSample sample;
  sample.utc_ns = 42;
  sample.velocity = Eigen::Vector3d(0.1, -0.2, 0.3);
  sample.range = {1.0, 2.0, 3.0, 4.0};
  sample.altitude = 2.5;
  sample.sound_speed = 1512;
  const DvlSample back = dvlSample(navInput(sample));
  EXPECT_EQ(back.utc_ns, 42);
  EXPECT_EQ(*back.velocity, *sample.velocity);
  EXPECT_EQ(back.range, sample.range);
  EXPECT_EQ(back.altitude, sample.altitude);
  EXPECT_EQ(back.sound_speed, 1512);
}

TEST(NavInput, KeepsWhatIsAbsentAbsent) {
  DvlSample sample;
  sample.range[2] = 3.0;
  const DvlSample back = dvlSample(navInput(sample));
  EXPECT_FALSE(back.velocity);
  EXPECT_FALSE(back.altitude);
  EXPECT_EQ(back.range, sample.range);
  EXPECT_FALSE(waterSample(navInput(WaterSample{})).sound_speed);
}

TEST(NavInput, CarriesTheOtherSensors) {
  const AttitudeSample attitude = attitudeSample(navInput(AttitudeSample{7, 0.1, 0.2, 0.3, false}));
  EXPECT_EQ(attitude.utc_ns, 7);
  EXPECT_EQ(attitude.roll, 0.1);
  EXPECT_EQ(attitude.pitch, 0.2);
  EXPECT_EQ(attitude.heading, 0.3);
  EXPECT_FALSE(attitude.magnetic);
  EXPECT_TRUE(attitudeSample(navInput(AttitudeSample{})).magnetic);
  const GyroSample rates = gyroSample(navInput(GyroSample{9, Eigen::Vector3d(0.1, -0.2, 0.3), {}}));
  EXPECT_EQ(rates.utc_ns, 9);
  EXPECT_EQ(*rates.body_rate, Eigen::Vector3d(0.1, -0.2, 0.3));
  EXPECT_FALSE(rates.heading_rate);
  const GyroSample turn = gyroSample(navInput(GyroSample{9, {}, -0.4}));
  EXPECT_EQ(turn.heading_rate, -0.4);
  EXPECT_FALSE(turn.body_rate);
  EXPECT_EQ(depthSample(navInput(DepthSample{8, 12.5})).depth, 12.5);
  WaterSample water;
  water.sound_speed = 1490;
  EXPECT_EQ(waterSample(navInput(water)).sound_speed, 1490);
}

}  // namespace
}  // namespace fathom::onboard

// What MapCore teaches its models of light.
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "realtime/onboard/map/map_core.hpp"

namespace fathom::onboard {
namespace {

constexpr int kWidth = 160, kHeight = 120;

MapCoreConfig config() {
  MapCoreConfig config;
  config.rig.left = {kWidth, kHeight, 200, 200, 80, 60, 0, 0, 0, 0, 0};
  config.rig.right = config.rig.left;
  config.rig.T_right_left = SE3::fromEuler(0, 0, 0, {-0.07, 0, 0});
  config.left_format = config.right_format = PixelFormat::kMono;
  config.map.max_tiles = 64;
  config.localisation.enabled = false;
  config.lighting.grid = 16;
  return config;
}

// Images of sand, which give stereo nothing, from a vehicle that moves by `step` a pair [m], 2 m up.
int imagesLearnt(int pairs, double step) {
  MapCore map(config());
  std::mt19937 random(5);
  std::vector<std::uint16_t> pixels(kWidth * kHeight);
  for (int k = 0; k < pairs; ++k) {
    for (std::uint16_t& p : pixels) p = static_cast<std::uint16_t>(1000 + random() % 64);
    MapInput input;
    input.pair_index = static_cast<std::uint32_t>(k);
    input.utc_ns = 1'700'000'000'000'000'000 + k * std::int64_t{500'000'000};
    input.T_odom_body = SE3::fromEuler(0, 0, 0, {step * k, 0, 10});
    input.altitude = 2;
    input.left = input.right = {pixels.data(), kWidth, kHeight, kWidth * 2, PixelFormat::kMono, 12};
    static_cast<void>(map.process(input));
  }
  return map.leftLight().report().images;
}

TEST(MapLight, IsNotLearntFromAVehicleThatHovers) {
  EXPECT_LE(imagesLearnt(100, 0.0005), 2);
  EXPECT_GE(imagesLearnt(100, 0.5), 100);
}

}  // namespace
}  // namespace fathom::onboard

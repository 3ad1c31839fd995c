// What MapCore teaches its models of light, and what a pair costs.
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "realtime/onboard/map/map_core.hpp"
#include "tests/support/heap_counter.hpp"

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

TEST(MapPair, TakesNothingFromTheHeap) {
  constexpr int kSpeckle = 3, kDisparity = 7;  // [px]; what the rig sees 2 m away
  MapCore map(config());
  std::mt19937 random(6);
  std::vector<std::uint16_t> left(kWidth * kHeight), right(left.size());
  std::vector<std::uint16_t> speckles(left.size());
  std::size_t points = 0;
  std::uint64_t heap_calls = 0;
  for (int k = 0; k < 5; ++k) {
    for (std::uint16_t& s : speckles) s = static_cast<std::uint16_t>(500 + random() % 3000);
    for (std::size_t y = 0; y < kHeight; ++y)
      for (std::size_t x = 0; x < kWidth; ++x) {
        left[y * kWidth + x] = speckles[y / kSpeckle * kWidth + x / kSpeckle];
        right[y * kWidth + x] = speckles[y / kSpeckle * kWidth + (x + kDisparity) / kSpeckle];
      }
    MapInput input;
    input.pair_index = static_cast<std::uint32_t>(k);
    input.utc_ns = 1'700'000'000'000'000'000 + k * std::int64_t{500'000'000};
    input.T_odom_body = SE3::fromEuler(0, 0, 0, {0.2 * k, 0, 10});
    input.altitude = 2;
    input.left = {left.data(), kWidth, kHeight, kWidth * 2, PixelFormat::kMono, 12};
    input.right = {right.data(), kWidth, kHeight, kWidth * 2, PixelFormat::kMono, 12};
    const test::ThreadCost before = test::threadCost();
    points = map.process(input).points;
    heap_calls = (test::threadCost() - before).heap_calls;
  }
  EXPECT_GT(points, 10u);
  EXPECT_EQ(test::sanitized() ? 0u : heap_calls, 0u);
}

}  // namespace
}  // namespace fathom::onboard

#include "realtime/onboard/link/mission_progress.hpp"

#include <gtest/gtest.h>

namespace fathom::onboard {
namespace {

// Two 20 m lines 2 m apart: 42 m in all.
const std::vector<Eigen::Vector2d> kLawnmower = {{0, 0}, {20, 0}, {20, 2}, {0, 2}};

TEST(MissionProgress, NeedsAPlan) {
  MissionProgress progress({});
  progress.update({3, 4});
  EXPECT_FALSE(progress.fraction().has_value());
}

TEST(MissionProgress, FollowsALawnmowerToItsEnd) {
  MissionProgress progress(kLawnmower, 0.5);
  for (double n = 0; n <= 20; n += 0.25) progress.update({n, 0.1});
  EXPECT_NEAR(*progress.fraction(), 20.0 / 42, 0.03);
  for (double e = 0; e <= 2; e += 0.25) progress.update({20, e});
  for (double n = 20; n >= 0; n -= 0.25) progress.update({n, 2.1});
  EXPECT_NEAR(*progress.fraction(), 1.0, 1e-9);
}

TEST(MissionProgress, DoesNotJumpToTheNeighbouringLine) {
  MissionProgress progress(kLawnmower, 0.5);
  for (double n = 0; n <= 10; n += 0.25)
    progress.update({n, 1.9});  // far off the first line, on the last one
  EXPECT_NEAR(*progress.fraction(), 10.0 / 42, 0.01);
}

TEST(MissionProgress, NeverRunsBackwards) {
  MissionProgress progress(kLawnmower, 0.5);
  progress.update({10, 0});
  const double before = *progress.fraction();
  progress.update({2, 0});
  EXPECT_EQ(*progress.fraction(), before);
}

TEST(MissionProgress, ACornerCutByTheTurnIsStillPassed) {
  MissionProgress progress({{0, 0}, {50, 0}, {50, 50}}, 1.0);
  for (double n = 0; n <= 45; n += 0.5) progress.update({n, 0});
  for (double a = 0; a <= 6; a += 0.25) progress.update({45 + 0.8 * a, a});
  for (double e = 6; e <= 25; e += 0.5) progress.update({49.8, e});
  EXPECT_NEAR(*progress.fraction(), 0.75, 0.02);
}

}  // namespace
}  // namespace fathom::onboard

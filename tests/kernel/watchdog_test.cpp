#include "realtime/kernel/tiers/watchdog.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

using Remedy = Watchdog::Remedy;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

constexpr std::int64_t kMs = 1'000'000;

std::vector<std::pair<std::size_t, Remedy>> step(Watchdog& dog, std::int64_t now) {
  std::vector<std::pair<std::size_t, Remedy>> asked;
  dog.step(now, [&](std::size_t tier, Remedy remedy) { asked.emplace_back(tier, remedy); });
  return asked;
}

TEST(Watchdog, LeavesATierAloneThatBeats) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMs, false, true});
  dog.watch(nav, 0);
  for (std::int64_t t = 0; t < 1000 * kMs; t += 50 * kMs) {
    dog.heartbeat(nav).beat(t);
    EXPECT_THAT(step(dog, t + 10 * kMs), IsEmpty());
  }
  EXPECT_TRUE(dog.vitalAlive());
  EXPECT_EQ(dog.state(nav).times_stuck, 0u);
}

TEST(Watchdog, LooksOnlyAtTiersThatAreWatched) {
  Watchdog dog;
  const std::size_t tier = dog.add({"rests", 100 * kMs, true, false});
  EXPECT_THAT(step(dog, 10'000 * kMs), IsEmpty());
  dog.watch(tier, 10'000 * kMs);
  EXPECT_THAT(step(dog, 10'050 * kMs), IsEmpty());
  dog.unwatch(tier);
  EXPECT_THAT(step(dog, 20'000 * kMs), IsEmpty());
}

TEST(Watchdog, StartsADeadDeviceThreadAgainAtGrowingIntervalsAndSaysWhenItIsBack) {
  Watchdog dog;
  const std::size_t can = dog.add({"can", 100 * kMs, true, false});
  dog.watch(can, 0);
  std::vector<std::int64_t> restarts;
  for (std::int64_t t = 0; t <= 3000 * kMs; t += 50 * kMs)
    for (const auto& [tier, remedy] : step(dog, t)) {
      EXPECT_EQ(remedy, Remedy::kRestart);
      restarts.push_back(t / kMs);
    }
  EXPECT_THAT(restarts, ElementsAre(100, 300, 700, 1500));
  dog.heartbeat(can).beat(3010 * kMs);
  EXPECT_THAT(step(dog, 3020 * kMs), ElementsAre(Pair(can, Remedy::kRecovered)));
  EXPECT_FALSE(dog.state(can).stuck);
  EXPECT_EQ(dog.state(can).times_stuck, 1u);
  EXPECT_EQ(dog.state(can).restarts, 4u);
  EXPECT_EQ(dog.state(can).longest_silent_ns, 3000 * kMs);
}

TEST(Watchdog, GivesUpOnceAndYetGoesOnTrying) {
  Watchdog dog;
  const std::size_t can = dog.add({"can", 100 * kMs, true, false});
  dog.watch(can, 0);
  int given_up = 0;
  for (std::int64_t t = 0; t <= 60'000 * kMs; t += 100 * kMs)
    for (const auto& [tier, remedy] : step(dog, t)) given_up += remedy == Remedy::kGiveUp;
  EXPECT_EQ(given_up, 1);
  EXPECT_TRUE(dog.state(can).given_up);
  EXPECT_GT(dog.state(can).restarts, std::uint64_t{Watchdog::kMaxRestarts});
}

TEST(Watchdog, DoesNotRestartVisionAndKeepsTheOthersGoing) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMs, false, true});
  const std::size_t vision = dog.add({"vision", 100 * kMs, false, false});
  dog.watch(nav, 0);
  dog.watch(vision, 0);
  dog.heartbeat(nav).beat(190 * kMs);
  EXPECT_THAT(step(dog, 200 * kMs), ElementsAre(Pair(vision, Remedy::kGiveUp)));
  dog.heartbeat(nav).beat(290 * kMs);
  EXPECT_THAT(step(dog, 300 * kMs), IsEmpty());
  EXPECT_TRUE(dog.vitalAlive());
}

TEST(Watchdog, AStuckNavigationIsNotReportedAsAlive) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMs, false, true});
  dog.watch(nav, 0);
  EXPECT_THAT(step(dog, 150 * kMs), ElementsAre(Pair(nav, Remedy::kGiveUp)));
  EXPECT_FALSE(dog.vitalAlive());
  dog.heartbeat(nav).beat(160 * kMs);
  EXPECT_THAT(step(dog, 170 * kMs), ElementsAre(Pair(nav, Remedy::kRecovered)));
  EXPECT_TRUE(dog.vitalAlive());
}

TEST(Watchdog, ABeatWithATimeOutOfTheWorldNeitherHidesNorMakesASilence) {
  Watchdog dog;
  const std::size_t tier = dog.add({"nav", 100 * kMs, false, true});
  dog.watch(tier, 1000 * kMs);
  dog.heartbeat(tier).beat(1'000'000'000 * kMs);
  EXPECT_THAT(step(dog, 1050 * kMs), IsEmpty());
  EXPECT_THAT(step(dog, 1200 * kMs), ElementsAre(Pair(tier, Remedy::kGiveUp)));
  dog.heartbeat(tier).beat(-5);
  EXPECT_THAT(step(dog, 1210 * kMs), IsEmpty());
}

TEST(Watchdog, TakesNoHeap) {
  Watchdog dog;
  const std::size_t tier = dog.add({"can", 100 * kMs, true, false});
  const test::ThreadCost before = test::threadCost();
  dog.watch(tier, 0);
  int asked = 0;
  for (std::int64_t t = 0; t < 1000 * kMs; t += 10 * kMs) dog.step(t, [&](std::size_t, Remedy) { ++asked; });
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_GT(asked, 0);
}

}  // namespace
}  // namespace fathom::rt

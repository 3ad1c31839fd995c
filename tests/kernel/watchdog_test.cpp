#include "realtime/kernel/threads/watchdog.hpp"
#include "realtime/base/units.hpp"

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

std::vector<std::pair<std::size_t, Remedy>> step(Watchdog& dog, std::int64_t now) {
  std::vector<std::pair<std::size_t, Remedy>> asked;
  dog.step(now, [&](std::size_t tier, Remedy remedy) { asked.emplace_back(tier, remedy); });
  return asked;
}

TEST(Watchdog, LeavesATierAloneThatBeats) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMillisecond_ns, false});
  dog.watch(nav, 0);
  for (std::int64_t t = 0; t < 1000 * kMillisecond_ns; t += 50 * kMillisecond_ns) {
    dog.heartbeat(nav).beat(t);
    EXPECT_THAT(step(dog, t + 10 * kMillisecond_ns), IsEmpty());
  }
  EXPECT_EQ(dog.state(nav).times_stuck, 0u);
}

TEST(Watchdog, LooksOnlyAtTiersThatAreWatched) {
  Watchdog dog;
  const std::size_t tier = dog.add({"rests", 100 * kMillisecond_ns, true});
  EXPECT_THAT(step(dog, 10'000 * kMillisecond_ns), IsEmpty());
  dog.watch(tier, 10'000 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 10'050 * kMillisecond_ns), IsEmpty());
  dog.unwatch(tier);
  EXPECT_THAT(step(dog, 20'000 * kMillisecond_ns), IsEmpty());
}

TEST(Watchdog, StartsADeadDeviceThreadAgainAtGrowingIntervalsAndSaysWhenItIsBack) {
  Watchdog dog;
  const std::size_t can = dog.add({"can", 100 * kMillisecond_ns, true});
  dog.watch(can, 0);
  std::vector<std::int64_t> restarts;
  for (std::int64_t t = 0; t <= 3000 * kMillisecond_ns; t += 50 * kMillisecond_ns)
    for (const auto& [tier, remedy] : step(dog, t)) {
      EXPECT_EQ(remedy, Remedy::kRestart);
      restarts.push_back(t / kMillisecond_ns);
    }
  EXPECT_THAT(restarts, ElementsAre(100, 300, 700, 1500));
  dog.heartbeat(can).beat(3010 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 3020 * kMillisecond_ns), ElementsAre(Pair(can, Remedy::kRecovered)));
  EXPECT_FALSE(dog.state(can).stuck);
  EXPECT_EQ(dog.state(can).times_stuck, 1u);
  EXPECT_EQ(dog.state(can).restarts, 4u);
  EXPECT_EQ(dog.state(can).longest_silent_ns, 3000 * kMillisecond_ns);
}

TEST(Watchdog, GivesUpOnceAndContinuesToTry) {
  Watchdog dog;
  const std::size_t can = dog.add({"can", 100 * kMillisecond_ns, true});
  dog.watch(can, 0);
  int given_up = 0;
  for (std::int64_t t = 0; t <= 60'000 * kMillisecond_ns; t += 100 * kMillisecond_ns)
    for (const auto& [tier, remedy] : step(dog, t)) given_up += remedy == Remedy::kGiveUp;
  EXPECT_EQ(given_up, 1);
  EXPECT_TRUE(dog.state(can).given_up);
  EXPECT_GT(dog.state(can).restarts, std::uint64_t{Watchdog::kMaxRestarts});
}

TEST(Watchdog, DoesNotRestartVisionAndKeepsTheOthersGoing) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMillisecond_ns, false});
  const std::size_t vision = dog.add({"vision", 100 * kMillisecond_ns, false});
  dog.watch(nav, 0);
  dog.watch(vision, 0);
  dog.heartbeat(nav).beat(190 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 200 * kMillisecond_ns), ElementsAre(Pair(vision, Remedy::kGiveUp)));
  dog.heartbeat(nav).beat(290 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 300 * kMillisecond_ns), IsEmpty());
}

TEST(Watchdog, ATierThatWasGivenUpRecoversWithItsNextBeat) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMillisecond_ns, false});
  dog.watch(nav, 0);
  EXPECT_THAT(step(dog, 150 * kMillisecond_ns), ElementsAre(Pair(nav, Remedy::kGiveUp)));
  dog.heartbeat(nav).beat(160 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 170 * kMillisecond_ns), ElementsAre(Pair(nav, Remedy::kRecovered)));
}

TEST(Watchdog, ABeatWithATimeOutOfTheWorldNeitherHidesNorMakesASilence) {
  Watchdog dog;
  const std::size_t tier = dog.add({"nav", 100 * kMillisecond_ns, false});
  dog.watch(tier, 1000 * kMillisecond_ns);
  dog.heartbeat(tier).beat(1'000'000'000 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 1050 * kMillisecond_ns), IsEmpty());
  EXPECT_THAT(step(dog, 1200 * kMillisecond_ns), ElementsAre(Pair(tier, Remedy::kGiveUp)));
  dog.heartbeat(tier).beat(-5);
  EXPECT_THAT(step(dog, 1210 * kMillisecond_ns), IsEmpty());
}

TEST(Watchdog, TakesNoHeap) {
  Watchdog dog;
  const std::size_t tier = dog.add({"can", 100 * kMillisecond_ns, true});
  const test::ThreadCost before = test::threadCost();
  dog.watch(tier, 0);
  int asked = 0;
  for (std::int64_t t = 0; t < 1000 * kMillisecond_ns; t += 10 * kMillisecond_ns)
    dog.step(t, [&](std::size_t, Remedy) { ++asked; });
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_GT(asked, 0);
}

}  // namespace
}  // namespace fathom::rt

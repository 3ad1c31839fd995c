#include "realtime/kernel/threads/overload_rule.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <thread>
#include <vector>

#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

constexpr std::int64_t kPairPeriod = 500'000'000;

OverloadRule::Observation frame(double share_of_period, int waiting = 0) {
  return {kPairPeriod, static_cast<std::int64_t>(share_of_period * static_cast<double>(kPairPeriod)), waiting,
          0};
}

// A vision tier on virtual time: pairs come every period into a queue of eight, a frame at `level` takes
// cost(level) of a period.
struct Simulated {
  OverloadRule rule;
  double queue_s = 0;  // work waiting, in periods
  double last = 0;
  std::vector<int> levels;
  int dropped = 0;

  template <typename Cost>
  void pairs(int count, Cost cost) {
    for (int i = 0; i < count; ++i) {
      const int waiting = static_cast<int>(queue_s);
      const auto decided = rule.decide({kPairPeriod, static_cast<std::int64_t>(last * kPairPeriod), waiting,
                                        static_cast<std::int64_t>(queue_s * kPairPeriod)});
      levels.push_back(static_cast<int>(decided.level));
      if (decided.drop) {
        ++dropped;
      } else {
        last = cost(static_cast<int>(decided.level));
        queue_s += last;
      }
      queue_s = std::max(0.0, queue_s - 1.0);
    }
  }
};

TEST(OverloadRule, AnEasyMissionIsMappedInFull) {
  OverloadRule rule;
  for (int i = 0; i < 1000; ++i) {
    const auto decided = rule.decide(frame(0.2));
    EXPECT_EQ(decided.level, DegradationLevel::kFull);
    EXPECT_FALSE(decided.drop);
  }
  EXPECT_EQ(rule.statistics().raised, 0u);
  EXPECT_EQ(rule.statistics().pairs[0], 1000u);
}

TEST(OverloadRule, OneSlowFrameChangesNothingTwoInARowDo) {
  OverloadRule rule;
  EXPECT_EQ(rule.decide(frame(2.0)).level, DegradationLevel::kFull);
  EXPECT_EQ(rule.decide(frame(0.3)).level, DegradationLevel::kFull);
  EXPECT_EQ(rule.decide(frame(2.0)).level, DegradationLevel::kFull);
  EXPECT_EQ(rule.decide(frame(2.0)).level, DegradationLevel::kFewerFeatures);
}

TEST(OverloadRule, LevelsRiseOneByOneInTheStatedOrder) {
  OverloadRule rule;
  std::vector<DegradationLevel> seen{rule.level()};
  for (int i = 0; i < 20; ++i) {
    const auto level = rule.decide(frame(1.5)).level;
    if (level != seen.back()) seen.push_back(level);
  }
  EXPECT_EQ(seen,
            (std::vector<DegradationLevel>{DegradationLevel::kFull, DegradationLevel::kFewerFeatures,
                                           DegradationLevel::kNoClosures, DegradationLevel::kCoarserFusion,
                                           DegradationLevel::kDropFrames}));
}

TEST(OverloadRule, ALongQueueDropsFramesAtOnceUntilItIsShort) {
  OverloadRule rule;
  const auto decided = rule.decide(frame(0.3, 5));
  EXPECT_EQ(decided.level, DegradationLevel::kDropFrames);
  EXPECT_TRUE(decided.drop);
  EXPECT_TRUE(rule.decide(frame(0.3, 2)).drop);
  EXPECT_FALSE(rule.decide(frame(0.3, 1)).drop);
  EXPECT_EQ(rule.statistics().dropped, 2u);
}

TEST(OverloadRule, AQueueThatNeverEmptiesCountsAsOverloadThoughFramesAreFast) {
  OverloadRule rule;
  for (int i = 0; i < 4; ++i) (void)rule.decide(frame(0.3, 2));
  EXPECT_GT(rule.level(), DegradationLevel::kFull);
}

TEST(OverloadRule, RecoversByItselfWhenAPassingOverloadIsOver) {
  Simulated vision;
  vision.pairs(50, [](int) { return 0.3; });
  vision.pairs(20, [](int level) { return level < 3 ? 1.6 : 0.8; });
  EXPECT_GE(*std::max_element(vision.levels.begin(), vision.levels.end()), 3);
  vision.pairs(200, [](int) { return 0.3; });
  EXPECT_EQ(vision.levels.back(), 0);
  EXPECT_EQ(vision.rule.statistics().raised > 0, true);
  EXPECT_EQ(vision.rule.statistics().lowered,
            static_cast<std::uint64_t>(std::count_if(
                vision.levels.begin() + 1, vision.levels.end(),
                [&, i = std::size_t{0}](int level) mutable { return level < vision.levels[i++]; })));
}

TEST(OverloadRule, ASteadyOverloadIsTriedLessAndLessOften) {
  Simulated vision;
  // Full work does not fit, the first level's does and looks easy: each try of full work is in vain.
  vision.pairs(3000, [](int level) { return level == 0 ? 1.3 : 0.4; });
  const auto full = [&](int from, int to) {
    return std::count(vision.levels.begin() + from, vision.levels.begin() + to, 0);
  };
  EXPECT_LT(full(0, 500), 500 / 10);  // a try every ten frames would take more
  EXPECT_LT(full(2500, 3000) * 2, full(0, 500));
  EXPECT_GT(full(2000, 3000), 0);  // and yet it is tried
  EXPECT_EQ(vision.dropped, 0);
}

TEST(OverloadRule, TheSameObservationsGiveTheSameDecisions) {
  Simulated a, b;
  for (Simulated* s : {&a, &b}) s->pairs(500, [](int level) { return 1.8 - 0.4 * level; });
  EXPECT_EQ(a.levels, b.levels);
  EXPECT_EQ(a.dropped, b.dropped);
}

TEST(OverloadRule, TheQueueStaysBoundedUnderAnOverloadThatNoLevelMeets) {
  Simulated vision;
  vision.pairs(1000, [](int) { return 3.0; });
  EXPECT_LT(vision.queue_s, 8.0);
  EXPECT_GT(vision.dropped, 500);
  EXPECT_LT(vision.dropped, 800);  // about a third still gets through
}

TEST(OverloadRule, BoundsThatContradictOneAnotherAreMadeToFit) {
  OverloadConfig config;
  config.raise_at = 0.3;  // below lower_at
  config.lower_after = 500;
  OverloadRule rule(config);
  for (int i = 0; i < 2; ++i) (void)rule.decide(frame(0.4));
  EXPECT_EQ(rule.level(), DegradationLevel::kFewerFeatures);
  for (int i = 0; i < 499; ++i) (void)rule.decide(frame(0.2));
  EXPECT_EQ(rule.level(), DegradationLevel::kFewerFeatures);
  EXPECT_EQ(rule.decide(frame(0.2)).level, DegradationLevel::kFull);
}

TEST(OverloadRule, TakesNoHeap) {
  OverloadRule rule;
  const test::ThreadCost before = test::threadCost();
  for (int i = 0; i < 100; ++i) (void)rule.decide(frame(i % 3 == 0 ? 0.2 : 1.5, i % 5));
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
}

TEST(OverloadRule, AnyThreadMayAskForTheLevelWhileAnotherDecides) {
  OverloadRule rule;
  std::thread vision([&rule] {
    for (int i = 0; i < 20; ++i) (void)rule.decide(frame(1.5));
  });
  while (rule.level() != DegradationLevel::kDropFrames) std::this_thread::yield();
  vision.join();
}

}  // namespace
}  // namespace fathom::rt

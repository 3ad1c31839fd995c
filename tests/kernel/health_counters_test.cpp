#include "realtime/kernel/health_counters.hpp"

#include <gtest/gtest.h>

#include <thread>

namespace fathom::rt {
namespace {

enum class Event { kDropped, kLate };
using Counters = HealthCounters<Event, 2>;
constexpr std::array<std::string_view, 2> kNames{"dropped", "late"};

TEST(HealthCounters, BeginAtZeroUnderTheirNames) {
  const Counters counters(kNames);
  const Counters::Snapshot all = counters.snapshot();
  EXPECT_EQ(all[0].name, "dropped");
  EXPECT_EQ(all[1].name, "late");
  EXPECT_EQ(all[0].value, 0u);
  EXPECT_EQ(all[1].value, 0u);
}

TEST(HealthCounters, CountEachEventByItself) {
  Counters counters(kNames);
  counters.add(Event::kLate);
  counters.add(Event::kLate, 4);
  EXPECT_EQ(counters.value(Event::kLate), 5u);
  EXPECT_EQ(counters.value(Event::kDropped), 0u);
  EXPECT_EQ(counters.snapshot()[1].value, 5u);
}

TEST(HealthCounters, LoseNothingBetweenTwoThreads) {
  Counters counters(kNames);
  const auto count = [&] {
    for (int i = 0; i < 10000; ++i) counters.add(Event::kDropped);
  };
  std::thread other(count);
  count();
  other.join();
  EXPECT_EQ(counters.value(Event::kDropped), 20000u);
}

}  // namespace
}  // namespace fathom::rt

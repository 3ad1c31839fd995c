#include "realtime/onboard/mapper/input_feed.hpp"

#include <gtest/gtest.h>

#include <memory>

#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

TEST(InputFeed, GoesOnWithoutWhatNeitherMemoryNorDiskHasInTimeAndCountsIt) {
  const test::TemporaryFolder folder;
  const auto down = std::make_unique<MapperDown>();
  InputFeed feed(folder.path(), *down, 0);
  constexpr std::uint64_t kMore = 100;
  for (std::uint64_t i = 0; i < InputBroadcast::capacity() + kMore; ++i)
    down->inputs.push({static_cast<std::int64_t>(i), io::Tick{}});
  io::OnboardInput input;
  ASSERT_TRUE(feed.next(input));
  const auto first = static_cast<std::uint64_t>(input.arrival_utc_ns);
  EXPECT_EQ(first, InputBroadcast::capacity() / 2 + kMore);
  EXPECT_EQ(feed.passedOver(), first);
  EXPECT_EQ(feed.skipped(), first);
  ASSERT_TRUE(feed.next(input));
  EXPECT_EQ(feed.position(), first + 2);
}

}  // namespace
}  // namespace fathom::onboard

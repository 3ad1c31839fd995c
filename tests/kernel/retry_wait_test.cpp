#include "realtime/kernel/retry_wait.hpp"

#include <gtest/gtest.h>

namespace fathom::rt {
namespace {

TEST(RetryWait, GrowsWithEachFailureToItsLongestAndBeginsAnewAfterASuccess) {
  RetryWait wait(10, 35);
  EXPECT_TRUE(wait.due(INT64_MIN)) << "nothing has failed yet";
  wait.failed(0);
  EXPECT_FALSE(wait.due(9));
  EXPECT_TRUE(wait.due(10));
  wait.failed(10);
  EXPECT_FALSE(wait.due(29));
  EXPECT_TRUE(wait.due(30));
  for (int i = 0; i < 100; ++i) wait.failed(30);
  EXPECT_FALSE(wait.due(64));
  EXPECT_TRUE(wait.due(65));
  wait.succeeded();
  EXPECT_TRUE(wait.due(0));
  wait.failed(0);
  EXPECT_TRUE(wait.due(10));
}

}  // namespace
}  // namespace fathom::rt

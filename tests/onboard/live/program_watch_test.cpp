// When the vehicle process ends because it cannot continue.
#include "realtime/onboard/live/program_watch.hpp"
#include "realtime/base/units.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

using testing::HasSubstr;

class Watched : public testing::Test {
 protected:
  std::string look() {
    now_ns += kSecond_ns / 5;
    return watch.look(now_ns, navigation, supervisor);
  }
  ProgramWatch watch{{2 * kSecond_ns, 5 * kSecond_ns}};
  std::int64_t now_ns = 0;
  std::uint64_t navigation = 0, supervisor = 0;
};

TEST_F(Watched, GoesOnWhileNavigationAndSupervisorLive) {
  for (int k = 0; k < 100; ++k) {
    ++navigation;
    if (k % 5 == 0) ++supervisor;
    EXPECT_EQ(look(), "");
    EXPECT_TRUE(watch.alive());
  }
}

TEST_F(Watched, EndsWhenNavigationIsSilentForItsLimit) {
  (void)look();
  int looks = 0;
  for (; looks < 100 && look().empty(); ++looks) ++supervisor;
  EXPECT_EQ(looks, 9);
  EXPECT_FALSE(watch.alive());
  EXPECT_THAT(look(), HasSubstr("navigation"));
}

TEST_F(Watched, EndsWhenTheSupervisorIsSilentForItsLimit) {
  (void)look();
  int looks = 0;
  for (; looks < 100 && look().empty(); ++looks) ++navigation;
  EXPECT_EQ(looks, 24);
  EXPECT_THAT(look(), HasSubstr("supervisor"));
}

TEST(HungRestarts, EachIsWaitedForTwiceAsLongOverStartsOfTheProgram) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(HungRestarts(folder.path()).patienceNs(2 * kSecond_ns), 4 * kSecond_ns);
  EXPECT_TRUE(HungRestarts(folder.path()).note());
  EXPECT_EQ(HungRestarts(folder.path()).patienceNs(2 * kSecond_ns), 8 * kSecond_ns);
  for (int k = 0; k < 30; ++k) EXPECT_TRUE(HungRestarts(folder.path()).note());
  EXPECT_EQ(HungRestarts(folder.path()).patienceNs(2 * kSecond_ns), 600 * kSecond_ns);
}

TEST(HungRestarts, WhereTheCountCannotBeKeptTheProgramDoesNotEnd) {
  HungRestarts restarts("/dev/null");
  EXPECT_FALSE(restarts.note());
}

}  // namespace
}  // namespace fathom::onboard

#include <gmock/gmock.h>

#include <string>

#include "realtime/kernel/tiers/realtime_config.hpp"
#include "tests/support/program_run.hpp"

namespace fathom::rt {
namespace {

std::string unitText() {
  return test::readText(FATHOM_SOURCE_DIR "/realtime/onboard/service/fathom-onboard.service");
}

// What systemd-analyze has to say against the unit; "" when all is well. It wants the program itself to be
// there, so that a copy of the unit names one that is.
std::string complaints(std::string unit) {
  const std::string key = "\nExecStart=";
  const std::size_t at = unit.find(key);
  EXPECT_NE(at, std::string::npos);
  const std::size_t end = unit.find('\n', at + 1);
  unit.replace(at, end - at, key + "/bin/true");
  const test::TemporaryFolder folder;
  const std::string path = (folder.path() / "fathom-onboard.service").string();
  test::writeText(path, unit);
  const test::Outcome run = test::runCommand("systemd-analyze verify --man=no " + path);
  return run.out + run.err;
}

bool analyzerThere() {
  return test::runCommand("systemd-analyze --version").exit_code == 0;
}

TEST(ServiceUnit, SystemdHasNothingToSayAgainstIt) {
  if (!analyzerThere()) GTEST_SKIP() << "systemd-analyze is absent; install systemd";
  EXPECT_EQ(complaints(unitText()), "");
}

TEST(ServiceUnit, AMisspeltKeyWouldBeSeen) {
  if (!analyzerThere()) GTEST_SKIP() << "systemd-analyze is absent; install systemd";
  EXPECT_THAT(complaints(unitText() + "\n[Service]\nLimitRTPRI=80\n"), testing::HasSubstr("LimitRTPRI"));
}

TEST(ServiceUnit, GrantsWhatArmingAsksForByDefault) {
  const std::string unit = unitText();
  EXPECT_THAT(unit, testing::HasSubstr("\nLimitRTPRIO=" + std::to_string(highestPriority({})) + "\n"));
  EXPECT_THAT(unit, testing::HasSubstr("\nLimitMEMLOCK=infinity\n"));
  EXPECT_THAT(unit, testing::HasSubstr("\nType=notify\n"));
  EXPECT_THAT(unit, testing::HasSubstr("\nRestart=on-failure\n"));
  EXPECT_THAT(unit, testing::Not(testing::HasSubstr("RestrictRealtime=yes")));
}

}  // namespace
}  // namespace fathom::rt

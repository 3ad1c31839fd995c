#include "sim/hil/fault_script.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/text_files.hpp"

namespace fathom::sim {
namespace {

using testing::HasSubstr;

std::string refusal(const std::string& text) {
  return test::refusal([&] { (void)parseFaultScript(text, "f.toml"); });
}

TEST(FaultScript, EveryKindIsReadWithItsOwnKeys) {
  const FaultScript s = parseFaultScript(R"(
[[fault]]
kind = "clock_step"
at_s = 90
step_s = -30
[[fault]]
kind = "lost_packets"
at_s = 10
for_s = 5
camera = "both"
every = 2
packets = 3
resend = true
[[fault]]
kind = "skew"
at_s = 20
for_s = 5
camera = "right"
offset_s = 0.04
)",
                                         "f.toml");
  ASSERT_EQ(s.faults.size(), 3U);
  EXPECT_EQ(s.faults[0].kind, FaultKind::kLostPackets) << "by begin";
  EXPECT_TRUE(s.faults[0].left && s.faults[0].right && s.faults[0].resend);
  EXPECT_EQ(s.faults[0].every, 2);
  EXPECT_EQ(s.faults[0].packets, 3);
  EXPECT_FALSE(s.faults[1].left);
  EXPECT_DOUBLE_EQ(s.faults[1].offset_s, 0.04);
  EXPECT_DOUBLE_EQ(s.faults[2].step_s, -30);
  EXPECT_EQ(s.camera(FaultKind::kSkew, CameraSide::kRight, 20), &s.faults[1]);
  EXPECT_EQ(s.camera(FaultKind::kSkew, CameraSide::kRight, 25), nullptr) << "the end is outside";
  EXPECT_EQ(s.camera(FaultKind::kSkew, CameraSide::kLeft, 22), nullptr);
}

TEST(FaultScript, ABadFileIsRefusedWithTheLineAndTheFix) {
  EXPECT_THAT(refusal("[[fault]]\nkind = \"dvl_silense\"\nat_s = 1\nfor_s = 1\n"),
              testing::AllOf(HasSubstr("f.toml"), HasSubstr("line 2"), HasSubstr("dvl_silence")));
  EXPECT_THAT(refusal("[[fault]]\nkind = \"dvl_silence\"\nat_s = -1\nfor_s = 1\n"), HasSubstr("line 3"));
  EXPECT_THAT(refusal("[[fault]]\nkind = \"dvl_silence\"\nat_s = 1\n"), HasSubstr("for_s"));
  EXPECT_THAT(refusal("[[fault]]\nkind = \"dvl_silence\"\nat_s = 1\nfor_s = 1\ncamera = \"left\"\n"),
              HasSubstr("line 5"))
      << "a key of another kind";
  EXPECT_THAT(refusal("[[fault]]\nkind = \"clock_step\"\nat_s = 1\nstep_s = 0\n"), HasSubstr("no step"));
  EXPECT_THAT(refusal("[[fault]\n"), HasSubstr("f.toml"));
  EXPECT_THAT(refusal("[[faults]]\nkind = \"dvl_silence\"\n"), HasSubstr("faults"));
}

TEST(FaultScript, TwoFaultsAtOneTimeOnOneDeviceAreRefusedAndOnTwoDevicesTaken) {
  const std::string garbage = "[[fault]]\nkind = \"dvl_garbage\"\nat_s = 5\nfor_s = 10\n";
  EXPECT_THAT(refusal(garbage + "[[fault]]\nkind = \"dvl_silence\"\nat_s = 14\nfor_s = 1\n"),
              HasSubstr("dvl_garbage"));
  EXPECT_EQ(refusal(garbage + "[[fault]]\nkind = \"dvl_silence\"\nat_s = 15\nfor_s = 1\n"), "");
  EXPECT_EQ(refusal(garbage + "[[fault]]\nkind = \"can_bus_off\"\nat_s = 6\nfor_s = 1\n"), "");
}

TEST(FaultScript, ExpectedCountsFollowTheMomentsAtWhichTheDevicesSpeak) {
  const FaultScript s = parseFaultScript(R"(
[[fault]]
kind = "lost_frames"
at_s = 2
for_s = 2
camera = "both"
every = 3
[[fault]]
kind = "dvl_silence"
at_s = 1
for_s = 1
[[fault]]
kind = "clock_step"
at_s = 3
for_s = 1
[[fault]]
kind = "camera_reboot"
at_s = 100
for_s = 1
)",
                                         "f.toml");
  PlayedTimes times;
  for (int i = 0; i < 20; ++i) times.left_s.push_back(0.5 * i);   // 2, 2.5, 3, 3.5 hit by the window
  for (int i = 0; i < 10; ++i) times.right_s.push_back(1.0 * i);  // 2, 3
  for (int i = 0; i < 50; ++i) times.dvl_s.push_back(0.2 * i + 0.1);
  const auto counts = s.expectedCounts(times);
  EXPECT_EQ(counts[static_cast<std::size_t>(FaultKind::kLostFrames)], 2U + 1U);
  EXPECT_EQ(counts[static_cast<std::size_t>(FaultKind::kDvlSilence)], 5U);
  EXPECT_EQ(counts[static_cast<std::size_t>(FaultKind::kClockStep)], 2U) << "there and back";
  EXPECT_EQ(counts[static_cast<std::size_t>(FaultKind::kCameraReboot)], 0U) << "after the end";
}

TEST(FaultScript, TheShippedCampaignsAreReadAndHoldEveryKind) {
  std::size_t files = 0;
  std::array<bool, kFaultKinds> seen{};
  for (const auto& entry :
       std::filesystem::directory_iterator(std::filesystem::path(FATHOM_SOURCE_DIR) / "sim/hil/faults")) {
    const FaultScript s = readFaultScript(entry.path());
    EXPECT_FALSE(s.faults.empty()) << entry.path();
    for (const Fault& f : s.faults) seen[static_cast<std::size_t>(f.kind)] = true;
    ++files;
  }
  EXPECT_GT(files, 1U);
  EXPECT_TRUE(std::ranges::all_of(seen, [](bool b) { return b; }));
}

}  // namespace
}  // namespace fathom::sim

#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <random>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/dvl_player.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/missions.hpp"

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

constexpr std::int64_t kStartNs = kMissionNs + 1'000'000 * kSecond_ns;

class MissionScheduleTest : public testing::Test {
 protected:
  void SetUp() override { writeTenSecondMission(folder_.path()); }
  [[nodiscard]] MissionSchedule make(ScheduleOptions options) const {
    options.start_utc_ns = kStartNs;
    return makeSchedule(folder_.path(), options);
  }
  test::TemporaryFolder folder_;
};

template <class Sample>
std::vector<std::pair<std::int64_t, Sample>> of(const MissionSchedule& schedule) {
  std::vector<std::pair<std::int64_t, Sample>> found;
  for (const ScheduledSample& s : schedule.samples)
    if (const auto* sample = std::get_if<Sample>(&s.sample))
      found.emplace_back(s.due_utc_ns - kStartNs, *sample);
  return found;
}

TEST_F(MissionScheduleTest, EverySampleKeepsItsDistanceFromTheBeginAndItsDelay) {
  const MissionSchedule s = make({});
  EXPECT_EQ(s.mission.start_utc_ns, kStartNs);
  const auto dvl = of<DvlSample>(s);
  ASSERT_EQ(dvl.size(), 50U);
  EXPECT_EQ(dvl[0].second.utc_ns - kStartNs, 100 * kMillisecond_ns);
  EXPECT_EQ(dvl[0].first, 160 * kMillisecond_ns) << "due when the recorder had it";
  EXPECT_EQ(dvl[0].second.velocity->x(), 0.4);
  const auto fixes = of<UsblFix>(s);
  ASSERT_EQ(fixes.size(), 1U);
  EXPECT_EQ(fixes[0].second.utc_ns - kStartNs, 3 * kSecond_ns);
  EXPECT_LT(fixes[0].first, 4 * kSecond_ns) << "the ship knows it soon; the modem brings it later";
  EXPECT_TRUE(std::is_sorted(s.samples.begin(), s.samples.end(),
                             [](const auto& a, const auto& b) { return a.due_utc_ns < b.due_utc_ns; }));
}

TEST_F(MissionScheduleTest, ExposuresAreAtTheirTrueTimesAndTheVehiclesCameraOffsetsAreZero) {
  const MissionSchedule s = make({});
  ASSERT_EQ(s.exposures.size(), 36U);
  for (std::size_t i = 0; i < s.exposures.size(); i += 2) {
    EXPECT_EQ(s.exposures[i].utc_ns, s.exposures[i + 1].utc_ns) << "20 ms were the camera's clock";
    EXPECT_EQ(s.exposures[i].utc_ns - kStartNs,
              kSecond_ns + static_cast<std::int64_t>(i / 2) * 500 * kMillisecond_ns);
  }
  EXPECT_EQ(s.mission.time_offsets.left_camera, 0);
}

TEST_F(MissionScheduleTest, AtTwiceTheRateTheVehicleIsTwiceAsFast) {
  const MissionSchedule s = make({.rate = 2});
  const auto dvl = of<DvlSample>(s);
  EXPECT_EQ(dvl[1].second.utc_ns - kStartNs, 150 * kMillisecond_ns);
  EXPECT_EQ(dvl[1].second.velocity->x(), 0.8);
  EXPECT_DOUBLE_EQ(s.missionSeconds(s.exposures.front().utc_ns), 1.0)
      << "fault scripts count mission seconds";
  EXPECT_EQ(s.vehicleTime(1.0), s.exposures.front().utc_ns);
}

TEST_F(MissionScheduleTest, TheReturnTrackIsTheOutwardTrackBackward) {
  const MissionSchedule s = make({.from_s = 1, .seconds = 5, .laps = 2});
  EXPECT_EQ(s.end_utc_ns - s.start_utc_ns, 10 * kSecond_ns);
  ASSERT_EQ(s.exposures.size(), 4U * 11U - 2U) << "the pair at the turning point once";
  const std::size_t last = s.exposures.size() - 1;
  for (std::size_t i = 0; i <= last; ++i) {
    EXPECT_EQ(s.exposures[i].utc_ns - s.start_utc_ns, s.end_utc_ns - s.exposures[last - i].utc_ns);
  }
  EXPECT_EQ(s.exposures[0].file_name, "L10.tif");
  EXPECT_EQ(s.exposures[last].file_name.substr(1), "10.tif");
  const auto dvl = of<DvlSample>(s);
  EXPECT_EQ(dvl.front().second.velocity->x(), 0.4);
  EXPECT_EQ(dvl.back().second.velocity->x(), -0.4);
  EXPECT_EQ(s.playedTimes().dvl_s.size(), dvl.size());
}

TEST_F(MissionScheduleTest, InstrumentsContinueAtRestBeforeAndAfterTheMission) {
  ScheduleOptions options{.rest_before_s = 2, .rest_after_s = 1};
  const auto dvl = of<DvlSample>(make(options));
  ASSERT_EQ(dvl.size(), 10U + 50U + 5U);
  for (std::size_t i = 1; i < dvl.size(); ++i)
    EXPECT_EQ(dvl[i].second.utc_ns - dvl[i - 1].second.utc_ns, 200 * kMillisecond_ns) << i;
  EXPECT_EQ(dvl[9].second.velocity->norm(), 0);
  EXPECT_GT(dvl[10].second.velocity->norm(), 0.3);
  EXPECT_EQ(dvl.back().second.velocity->norm(), 0);
  const auto attitude = of<AttitudeSample>(make(options));
  EXPECT_EQ(attitude.size(), 20U + 100U + 10U);
  EXPECT_EQ(attitude.front().second.heading, 0);
  EXPECT_EQ(attitude.back().second.heading, attitude[119].second.heading);
  EXPECT_EQ(make(options).end_utc_ns, make({}).end_utc_ns);
}

TEST_F(MissionScheduleTest, AMissionThatShowsNothingIsRefused) {
  ScheduleOptions options{.from_s = 9.8};
  EXPECT_THROW((void)make(options), InputError);
  EXPECT_THROW((void)makeSchedule(folder_.path() / "absent", {}), InputError);
  std::filesystem::remove(folder_.path() / "img");
  std::filesystem::create_directories(folder_.path() / "features");
  EXPECT_THROW((void)make({}), InputError);
}

constexpr std::int64_t kUtcNs = 1'772'330'400'123'456'789;  // 2026-03-01

DvlSample decode(std::span<const std::uint8_t> bytes, std::uint32_t expected_number) {
  io::Pd0Decoder decoder;
  std::optional<DvlSample> sample;
  int ensembles = 0;
  const auto take = [&](const io::Pd0Ensemble& e) {
    sample = io::toDvlSample(e);
    EXPECT_EQ(e.number, expected_number);
    ++ensembles;
  };
  decoder.feed(bytes, take);
  decoder.drain(take);
  EXPECT_EQ(ensembles, 1);
  EXPECT_EQ(decoder.counts().skipped_bytes, 0U);
  return sample.value_or(DvlSample{});
}

TEST(Pd0Encoder, WhatIsEncodedIsDecodedWithinTheFormatsResolution) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> speed(-2, 2), range(0.6, 800), angle(-0.4, 0.4), turn(-7, 7);
  for (std::uint32_t n = 1; n < 400; ++n) {
    DvlSample in;
    in.utc_ns = kUtcNs + static_cast<std::int64_t>(n) * 123'456'789;
    in.velocity = Eigen::Vector3d(speed(random), speed(random), speed(random));
    for (auto& r : in.range) r = range(random);
    in.sound_speed = 1500 + n % 40;
    const Pd0Attitude attitude = {turn(random), angle(random), angle(random)};
    const DvlSample out = decode(encodePd0(in, n * 40'000, attitude), n * 40'000);
    EXPECT_EQ(out.utc_ns, roundToPd0Clock(in.utc_ns));
    EXPECT_LE(std::abs(out.utc_ns - in.utc_ns), 5'000'000);
    ASSERT_TRUE(out.velocity.has_value());
    EXPECT_LE((*out.velocity - *in.velocity).cwiseAbs().maxCoeff(), 0.0005 + 1e-9);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(out.range[i].value_or(-1), *in.range[i], 0.005 + 1e-9);
    EXPECT_EQ(out.sound_speed, in.sound_speed);
    // Altitude over a flat bottom: the harmonic mean of opposite beams times the cosine of the tilt.
    const double cos_tilt = std::cos(attitude.pitch) * std::cos(attitude.roll);
    const auto pair = [&](std::size_t i) { return 2 * cos_tilt / (1 / *in.range[i] + 1 / *in.range[i + 1]); };
    EXPECT_NEAR(out.altitude.value_or(-1), (pair(0) + pair(2)) / 2, 0.01 + 2e-4 * *out.altitude);
  }
}

TEST(Pd0Encoder, WhatIsAbsentStaysAbsent) {
  DvlSample in;
  in.utc_ns = kUtcNs;
  in.range[1] = 3.0;
  DvlSample out = decode(encodePd0(in, 7, {}), 7);
  EXPECT_FALSE(out.velocity.has_value());
  EXPECT_FALSE(out.range[0].has_value());
  EXPECT_TRUE(out.range[1].has_value());
  EXPECT_FALSE(out.altitude.has_value()) << "no pair of beams is whole";

  in.velocity = Eigen::Vector3d(0, 40, 0);
  out = decode(encodePd0(in, 8, {}), 8);
  EXPECT_FALSE(out.velocity.has_value()) << "faster than the format can say";
}

TEST(Pd0Encoder, TheClockRollsOverTheYearAndRoundsToItsNearestStep) {
  constexpr std::int64_t kNewYear2027Ns = 1'798'761'600'000'000'000;
  DvlSample in;
  in.utc_ns = kNewYear2027Ns - 4'000'000;
  EXPECT_EQ(decode(encodePd0(in, 1, {}), 1).utc_ns, kNewYear2027Ns);
  EXPECT_EQ(roundToPd0Clock(-4'000'000), 0);
  EXPECT_EQ(roundToPd0Clock(-6'000'000), -10'000'000);
}

}  // namespace
}  // namespace fathom::sim

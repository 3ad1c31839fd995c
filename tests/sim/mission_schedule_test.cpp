#include "sim/hil/mission_schedule.hpp"
#include "realtime/base/units.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "realtime/base/input_error.hpp"
#include "tests/sim/hil_mission.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::sim {
namespace {

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
  ScheduleOptions options;
  options.rate = 2;
  const MissionSchedule s = make(options);
  const auto dvl = of<DvlSample>(s);
  EXPECT_EQ(dvl[1].second.utc_ns - kStartNs, 150 * kMillisecond_ns);
  EXPECT_EQ(dvl[1].second.velocity->x(), 0.8);
  EXPECT_DOUBLE_EQ(s.missionSeconds(s.exposures.front().utc_ns), 1.0)
      << "fault scripts count mission seconds";
  EXPECT_EQ(s.vehicleTime(1.0), s.exposures.front().utc_ns);
}

TEST_F(MissionScheduleTest, TheReturnTrackIsTheOutwardTrackBackward) {
  ScheduleOptions options;
  options.laps = 2;
  options.from_s = 1;
  options.seconds = 5;
  const MissionSchedule s = make(options);
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
  ScheduleOptions options;
  options.rest_before_s = 2;
  options.rest_after_s = 1;
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
  ScheduleOptions options;
  options.from_s = 9.8;
  EXPECT_THROW((void)make(options), InputError);
  EXPECT_THROW((void)makeSchedule(folder_.path() / "absent", {}), InputError);
  std::filesystem::remove(folder_.path() / "img");
  std::filesystem::create_directories(folder_.path() / "features");
  EXPECT_THROW((void)make({}), InputError);
}

}  // namespace
}  // namespace fathom::sim

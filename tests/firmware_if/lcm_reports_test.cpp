#include <gtest/gtest.h>

#include <bit>
#include <fathom/health_t.hpp>
#include <fathom/link_t.hpp>
#include <fathom/map_t.hpp>
#include <fathom/pose_t.hpp>

#include "firmware_if/devices/lcm/health_report.hpp"
#include "firmware_if/devices/lcm/lcm_source.hpp"
#include "firmware_if/mission/log/checked_message.hpp"
#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/units.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kReport_ns = 1'700'000'000 * kSecond_ns;

template <class Message>
Message received(const LogMessage& message) {
  Message m = {};
  EXPECT_TRUE(checkHolds(message.data));
  EXPECT_TRUE(decodeWhole(message.data, m));
  return m;
}

HealthReport sampleHealth() {
  HealthReport health;
  health.utc_ns = kReport_ns;
  health.soft = true;
  health.degradation = 2;
  health.uptime_s = 3600.5;
  health.resident_mib = 401;
  health.temperature_c = 61.5;
  health.stages.add({"stereo", 100, 1, 12, 11, 40, 55});
  health.stages.add({"slam", 99, 0, 2, 1, 4, 5});
  health.fills.add({"hard ring", 3, 17, 4096, 0});
  health.drops.add({"pairs_full", 7});
  health.devices.add({"dvl", true, 0.25, 1000, 1});
  health.devices.add({"can", false, std::nullopt, 0, 0});
  return health;
}

TEST(HealthReport, StandsInItsMessage) {
  const LogMessage message = encodeHealth(sampleHealth());
  EXPECT_EQ(message.channel, "FATHOM_HEALTH");
  const auto decoded = received<health_t>(message);
  EXPECT_EQ(decoded.utc_ns, kReport_ns);
  EXPECT_TRUE(decoded.soft);
  EXPECT_EQ(decoded.degradation, 2);
  EXPECT_FALSE(decoded.has_system[0]);
  EXPECT_TRUE(decoded.has_system[1]);
  EXPECT_EQ(decoded.system[1], 61.5);
  ASSERT_EQ(decoded.stages.size(), 2u);
  EXPECT_EQ(decoded.stages[0].name, "stereo");
  EXPECT_EQ(decoded.stages[0].max_ms, 55);
  EXPECT_EQ(decoded.fills.at(0).high_water, 17);
  EXPECT_EQ(decoded.drops.at(0).value, 7);
  ASSERT_EQ(decoded.devices.size(), 2u);
  EXPECT_EQ(decoded.devices[0].silent, 0.25);
  EXPECT_FALSE(decoded.devices[1].has_data);
}

TEST(HealthReport, FillingTakesNoMemoryAndStopsWhenFull) {
  const auto before = test::threadCost();
  HealthReport health = sampleHealth();
  for (int i = 0; i < 200; ++i)
    health.drops.add({"a name that is far too long for the place that it has", 1});
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_EQ(health.drops.size(), health.drops.capacity());
  EXPECT_EQ(health.drops[5].name.view().size(), ShortName::kMax);
  EXPECT_FALSE(health.drops.add({"more", 1}));
  EXPECT_EQ(received<health_t>(encodeHealth(health)).drops.size(), health.drops.size());
}

TEST(PoseReport, BothMessagesSayTheSamePlace) {
  PoseReport pose{.utc_ns = kReport_ns,
                  .latitude = -0.6,
                  .longitude = 2.0,
                  .position = {10, 20, 30},
                  .attitude = Eigen::AngleAxisd(4.0, Eigen::Vector3d::UnitZ()) *
                              Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitY()) *
                              Eigen::AngleAxisd(-0.1, Eigen::Vector3d::UnitX()),
                  .velocity = {0.5, 0.1, -0.05},
                  .altitude = 2.5,
                  .sigma_horizontal = {}};
  const auto decoded = received<pose_t>(encodePose(pose));
  const double* q = decoded.attitude;
  EXPECT_TRUE(Eigen::Quaterniond(q[0], q[1], q[2], q[3]).isApprox(pose.attitude));
  EXPECT_EQ(Eigen::Vector3d(decoded.position), pose.position);
  EXPECT_EQ(decoded.altitude, 2.5);
  EXPECT_FALSE(decoded.has_sigma);
  const LogMessage acfr = encodeAcfrNav(pose, "sirius");
  EXPECT_EQ(acfr.channel, "sirius.ACFR_NAV");
  // Fingerprint, utime and 16 doubles, big endian.
  ASSERT_EQ(acfr.data.size(), 8u + 8 + 16 * 8);
  const auto number = [&](std::size_t field) {
    return std::bit_cast<double>(bigEndianAt<std::uint64_t>(acfr.data, 16 + 8 * field));
  };
  EXPECT_NEAR(number(0), -34.377468, 1e-6);
  EXPECT_EQ(number(4), 30);
  EXPECT_NEAR(number(5), -0.1, 1e-12);
  EXPECT_NEAR(number(6), 0.2, 1e-12);
  EXPECT_NEAR(number(7), 4.0, 1e-12);
  EXPECT_EQ(number(14), 2.5);
}

TEST(LinkAndMapReport, StandInTheirMessages) {
  LinkReport link{.open = true, .heard_ago_s = {}, .share_on_ship = 0.5, .frames_sent = 12, .counts = {}};
  link.counts.add({"resent", 3});
  const auto decoded_link = received<link_t>(encodeLink(link));
  EXPECT_TRUE(decoded_link.open);
  EXPECT_FALSE(decoded_link.heard);
  EXPECT_EQ(decoded_link.frames_sent, 12);
  EXPECT_EQ(decoded_link.share_told, 0.5);
  EXPECT_EQ(decoded_link.counts.at(0).name, "resent");
  MapReport map{.pairs = 100, .area_m2 = 12.5, .counts = {}};
  map.counts.add({"pairs_dropped", 3});
  const auto decoded_map = received<map_t>(encodeMap(map));
  EXPECT_EQ(decoded_map.pairs, 100);
  EXPECT_EQ(decoded_map.area, 12.5);
  EXPECT_EQ(decoded_map.counts.at(0).value, 3);
}

}  // namespace
}  // namespace fathom::io

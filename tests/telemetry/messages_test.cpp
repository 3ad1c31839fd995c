#include <gtest/gtest.h>

#include <random>
#include <set>

#include "realtime/base/units.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/uplink_messages.hpp"
#include "tests/telemetry/sample_frames.hpp"

namespace fathom::telemetry {
namespace {

using Buffer = std::array<std::uint8_t, kMaxFrameBytes>;

Status someStatus() {
  Status s;
  s.utc_ns = kStart_ns + 12'345'600'000;
  s.north = -1234.56;
  s.east = 789.04;
  s.depth = 43.21;
  s.roll = -0.03;
  s.pitch = 0.08;
  s.heading = 4.5;
  s.altitude = 2.13;
  s.speed = 0.52;
  s.position_sigma = 1.26;
  s.pairs_seen = 36000;
  s.pairs_dropped = 988;
  s.map_area = 5321.4;
  s.battery = 0.73;
  s.mission_progress = 0.42;
  s.health = kHealthNoFix | kHealthStereoPoor;
  s.late_cycles = 3;
  s.shed_work = 17;
  s.pool_refusals = 1023;
  return s;
}

TEST(Health, EachFlagHasATextOfItsOwnAndCrossesTheLink) {
  std::set<std::string> texts;
  for (unsigned bit = 0; bit < kHealthBits; ++bit) {
    texts.insert(healthText(bit));
    Status s, back;
    s.health = static_cast<std::uint16_t>(1U << bit);
    std::array<std::uint8_t, kStatusBytes> payload{};
    ASSERT_EQ(encodeStatus(s, payload), kStatusBytes);
    ASSERT_TRUE(decodeStatus(payload, back));
    EXPECT_EQ(back.health, s.health) << healthText(bit);
  }
  EXPECT_EQ(texts.size(), kHealthBits);
  EXPECT_EQ(texts.count("unknown"), 0u);
  EXPECT_EQ(texts.count("clock unsure"), 1u);
}

void expectSameStatus(const Status& a, const Status& b) {
  const auto near = [](double x, double y, const LogField& field) {
    EXPECT_LE(std::abs(x / y - 1), field.relativeError() + 0.5 / y) << x << " " << y;
  };
  EXPECT_NEAR(static_cast<double>(a.utc_ns - b.utc_ns), 0, 0.25e9 + 1);
  EXPECT_NEAR(a.north, b.north, 0.101);
  EXPECT_NEAR(a.east, b.east, 0.101);
  EXPECT_NEAR(a.depth, b.depth, 0.051);
  EXPECT_NEAR(a.roll, b.roll, 1.01 * kRadiansPerDegree);
  EXPECT_NEAR(a.pitch, b.pitch, 1.01 * kRadiansPerDegree);
  EXPECT_NEAR(std::remainder(a.heading - b.heading, 2 * std::numbers::pi), 0, 0.76 * kRadiansPerDegree);
  EXPECT_NEAR(a.altitude, b.altitude, 0.051);
  EXPECT_NEAR(a.speed, b.speed, 0.051);
  EXPECT_NEAR(a.battery, b.battery, 0.0101);
  EXPECT_NEAR(a.mission_progress, b.mission_progress, 0.0101);
  EXPECT_EQ(a.health, b.health);
  EXPECT_LE(std::abs(a.position_sigma / b.position_sigma - 1), schema::kPositionSigma.relativeError());
  near(a.map_area, b.map_area, schema::kArea);
  near(a.pairs_seen, b.pairs_seen, schema::kPairs);
  near(a.pairs_dropped, b.pairs_dropped, schema::kDropped);
  near(a.late_cycles, b.late_cycles, schema::kLateCycles);
  near(a.shed_work, b.shed_work, schema::kShed);
  near(a.pool_refusals, b.pool_refusals, schema::kRefusals);
}

TEST(Status, RoundTripsWithinItsResolution) {
  Buffer buffer{};
  const Status sent = someStatus();
  const std::size_t size = encodeStatus(sent, buffer);
  ASSERT_EQ(size, kStatusBytes);
  Status got;
  ASSERT_TRUE(decodeStatus(std::span(buffer).first(size), got));
  expectSameStatus(got, sent);
}

TEST(Status, FitsTheSmallestFrame) {
  EXPECT_LE(kStatusBytes + kFrameOverhead, kMinFrameBytes);
}

TEST(Status, AbsentStaysAbsentAndHeadingWrapsToNorth) {
  Buffer buffer{};
  Status sent = someStatus();
  sent.altitude = sent.position_sigma = sent.mission_progress = sent.battery = kAbsent;
  sent.heading = -0.0001;
  const std::size_t size = encodeStatus(sent, buffer);
  Status got;
  ASSERT_TRUE(decodeStatus(std::span(buffer).first(size), got));
  EXPECT_TRUE(std::isnan(got.altitude) && std::isnan(got.position_sigma) &&
              std::isnan(got.mission_progress) && std::isnan(got.battery));
  EXPECT_EQ(got.heading, 0);
}

TEST(Status, OutOfBoundsSaturates) {
  Buffer buffer{};
  Status sent = someStatus();
  sent.north = 1e9;
  sent.pool_refusals = 4'000'000;
  sent.heading = NAN;
  const std::size_t size = encodeStatus(sent, buffer);
  Status got;
  ASSERT_TRUE(decodeStatus(std::span(buffer).first(size), got));
  EXPECT_NEAR(got.north, schema::kStatusHorizontal.max, 1e-6);
  EXPECT_EQ(got.pool_refusals, 8192U);
}

TEST(Status, TruncatedAtAnyByteOrTooLongLeavesTheOldStatus) {
  Buffer buffer{};
  const std::size_t size = encodeStatus(someStatus(), buffer);
  for (std::size_t n = 0; n <= size + 3; ++n) {
    Status got;
    EXPECT_EQ(decodeStatus(std::span(buffer).first(n), got), n == size);
    if (n != size) {
      EXPECT_EQ(got.pairs_seen, 0U);
    }
  }
  EXPECT_EQ(encodeStatus(someStatus(), std::span(buffer).first(size - 1)), 0U);
}

std::vector<TrackPoint> someTrack(int count, double step_m, unsigned seed = 4) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> u(-step_m, step_m);
  std::vector<TrackPoint> points;
  TrackPoint p{kStart_ns, 100, -200, 30};
  for (int i = 0; i < count; ++i) {
    points.push_back(p);
    p = {p.utc_ns + 5 * kSecond_ns, p.north + u(random), p.east + u(random), p.depth + u(random) / 10};
  }
  return points;
}

TEST(Track, RoundTripsTheNewestPointsThatFit) {
  Buffer buffer{};
  const auto points = someTrack(80, 3);
  for (const std::size_t room : {13U, 22U, 40U, 100U, 246U}) {
    const std::size_t size = encodeTrack(points, std::span(buffer).first(room));
    ASSERT_GT(size, 0U);
    ASSERT_LE(size, room);
    std::array<TrackPoint, kMaxTrackPoints> got;
    const std::size_t count = decodeTrack(std::span(buffer).first(size), got);
    ASSERT_GT(count, 0U);
    if (room == 246) {
      EXPECT_EQ(count, kMaxTrackPoints);
    }
    for (std::size_t i = 0; i < count; ++i) {
      const TrackPoint& want = points[points.size() - count + i];
      EXPECT_EQ(got[i].utc_ns, want.utc_ns);
      EXPECT_NEAR(got[i].north, want.north, 0.051);
      EXPECT_NEAR(got[i].east, want.east, 0.051);
      EXPECT_NEAR(got[i].depth, want.depth, 0.026);
    }
  }
}

TEST(Track, APointDecodesTheSameFromEveryMessage) {
  Buffer buffer{};
  const auto points = someTrack(30, 3);
  std::array<TrackPoint, kMaxTrackPoints> a, b;
  const auto decode = [&](std::size_t count, std::span<TrackPoint> out) {
    const std::size_t size = encodeTrack(std::span(points).first(count), buffer);
    return decodeTrack(std::span(buffer).first(size), out);
  };
  ASSERT_EQ(decode(20, a), 20U);
  ASSERT_EQ(decode(30, b), 30U);
  for (std::size_t i = 0; i < 20; ++i) {
    EXPECT_EQ(a[i].utc_ns, b[i].utc_ns);
    EXPECT_EQ(a[i].north, b[i].north);
    EXPECT_EQ(a[i].depth, b[i].depth);
  }
}

TEST(Track, AJumpOfThePositionIsCarried) {
  Buffer buffer{};
  auto points = someTrack(4, 1);
  points[3].north = -40000;
  const std::size_t size = encodeTrack(points, buffer);
  std::array<TrackPoint, kMaxTrackPoints> got;
  ASSERT_EQ(decodeTrack(std::span(buffer).first(size), got), 4U);
  EXPECT_NEAR(got[2].north, points[2].north, 0.051);
  EXPECT_NEAR(got[3].north, -40000, 0.051);
}

TEST(Track, StopsAtAHoleInTimeThatItsFieldCannotSpan) {
  Buffer buffer{};
  auto points = someTrack(10, 1);
  for (std::size_t i = 6; i < 10; ++i) points[i].utc_ns += 600 * kSecond_ns;
  std::array<TrackPoint, kMaxTrackPoints> got;
  const std::size_t size = encodeTrack(points, buffer);
  EXPECT_EQ(decodeTrack(std::span(buffer).first(size), got), 4U);
}

TEST(Track, TruncatedAtAnyByteIsRejected) {
  Buffer buffer{};
  const auto points = someTrack(20, 3);
  const std::size_t size = encodeTrack(points, buffer);
  std::array<TrackPoint, kMaxTrackPoints> got;
  for (std::size_t n = 0; n < size; ++n) EXPECT_EQ(decodeTrack(std::span(buffer).first(n), got), 0U) << n;
  EXPECT_EQ(encodeTrack({}, buffer), 0U);
}

TEST(MissionInfo, RoundTripsToACentimetreOnTheGround) {
  Buffer buffer{};
  const MissionInfo sent{
      "sirius", {-23.456789 * kRadiansPerDegree, 151.987654 * kRadiansPerDegree}, kStart_ns, 0};
  const std::size_t size = encodeMissionInfo(sent, buffer);
  MissionInfo got;
  ASSERT_TRUE(decodeMissionInfo(std::span(buffer).first(size), got));
  EXPECT_EQ(got.vehicle_name, "sirius");
  EXPECT_NEAR(got.origin.latitude, sent.origin.latitude, 0.51e-7 * kRadiansPerDegree);
  EXPECT_NEAR(got.origin.longitude, sent.origin.longitude, 0.51e-7 * kRadiansPerDegree);
  EXPECT_EQ(got.start_utc_ns, kStart_ns);
  EXPECT_EQ(got.schema_hash, schemaHash());
  for (std::size_t n = 0; n < size; ++n)
    EXPECT_FALSE(decodeMissionInfo(std::span(buffer).first(n), got)) << n;
}

TEST(MissionInfo, CutsALongNameToTheFrameAndSendsNoControlCharacters) {
  Buffer buffer{};
  const MissionInfo sent{"a vehicle\nwith a name much longer than any frame", {}, kStart_ns, 0};
  MissionInfo got;
  std::size_t size = encodeMissionInfo(sent, std::span(buffer).first(kMinFrameBytes - kFrameOverhead));
  ASSERT_TRUE(decodeMissionInfo(std::span(buffer).first(size), got));
  EXPECT_EQ(got.vehicle_name, sent.vehicle_name.substr(0, got.vehicle_name.size()));
  EXPECT_GE(got.vehicle_name.size(), 6U);
  size = encodeMissionInfo(sent, buffer);
  ASSERT_TRUE(decodeMissionInfo(std::span(buffer).first(size), got));
  EXPECT_EQ(got.vehicle_name, "a vehicle?with a name much long");
}

}  // namespace
}  // namespace fathom::telemetry

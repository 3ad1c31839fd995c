// What needs no camera: pixels, ids, the camera's clock, the configuration.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "firmware_if/devices/camera/camera_clock_map.hpp"
#include "firmware_if/devices/camera/camera_config.hpp"
#include "firmware_if/devices/camera/pixel_unpack.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kMs = 1'000'000, kS = 1'000'000'000;
constexpr std::int64_t kUtc = 1'800'000'000 * kS;

std::vector<std::byte> bytesOf(std::initializer_list<int> values) {
  std::vector<std::byte> bytes;
  for (const int value : values) bytes.push_back(static_cast<std::byte>(value));
  return bytes;
}

std::vector<std::uint16_t> unpackWords(WirePacking packing, std::size_t pixels,
                                       const std::vector<std::byte>& wire) {
  std::vector<std::uint16_t> words(pixels);
  EXPECT_TRUE(unpackPixels(packing, pixels, wire, std::as_writable_bytes(std::span(words))));
  return words;
}

TEST(PixelUnpack, ReadsTwelveBitsAsTheStandardsPackThem) {
  using Words = std::vector<std::uint16_t>;
  // 0x123 and 0xabc by GigE Vision's own packing: high bits of each in the outer bytes.
  EXPECT_EQ(unpackWords(WirePacking::kPacked12, 2, bytesOf({0x12, 0xc3, 0xab})), (Words{0x123, 0xabc}));
  // The same as a stream of bits, lowest first.
  EXPECT_EQ(unpackWords(WirePacking::kBits12, 2, bytesOf({0x23, 0xc1, 0xab})), (Words{0x123, 0xabc}));
  // Bits that do not belong to a pixel are dropped.
  EXPECT_EQ(unpackWords(WirePacking::kWords12, 1, bytesOf({0x23, 0xf1})), (Words{0x123}));
}

TEST(PixelUnpack, GivesBackWhatWasPackedForAnyNumberOfPixels) {
  std::mt19937 random(3);
  for (const WireFormat& format : wireFormats())
    for (const std::size_t pixels : {1U, 2U, 3U, 96U, 97U}) {
      std::vector<std::byte> frame(frameBytes(format.packing, pixels)), back(frame.size());
      for (std::size_t i = 0; i < frame.size(); ++i)
        frame[i] =
            static_cast<std::byte>(format.bits == 12 && i % 2 == 1 ? random() & 0x0f : random() & 0xff);
      std::vector<std::byte> wire(wireBytes(format.packing, pixels));
      EXPECT_EQ(wire.size(), (pixels * static_cast<std::size_t>((format.code >> 16) & 0xff) + 7) / 8)
          << format.name;
      ASSERT_TRUE(packPixels(format.packing, pixels, frame, wire));
      ASSERT_TRUE(unpackPixels(format.packing, pixels, wire, back));
      EXPECT_EQ(back, frame) << format.name << " " << pixels;
    }
}

TEST(PixelUnpack, TouchesNothingWhenEitherSideIsTooShort) {
  for (const WireFormat& format : wireFormats()) {
    constexpr std::size_t kPixels = 5;
    const std::size_t wire = wireBytes(format.packing, kPixels), out = frameBytes(format.packing, kPixels);
    std::vector<std::byte> from(wire, std::byte{0xff}), to(out, std::byte{7});
    EXPECT_TRUE(unpackPixels(format.packing, 0, {}, {}));
    EXPECT_FALSE(unpackPixels(format.packing, kPixels, std::span(from).first(wire - 1), to));
    EXPECT_FALSE(unpackPixels(format.packing, kPixels, from, std::span(to).first(out - 1)));
    for (const std::byte byte : to) EXPECT_EQ(byte, std::byte{7});
  }
}

TEST(FrameIdUnwrap, ContinuesWhereSixteenBitsWrapAndSkipsZero) {
  FrameIdUnwrap ids;
  EXPECT_EQ(ids.add(65533, 10).id, 65533u);
  EXPECT_EQ(ids.add(65534, 10).id, 65534u);
  EXPECT_EQ(ids.add(65535, 10).id, 65535u);
  const auto wrapped = ids.add(1, 10);
  EXPECT_EQ(wrapped.id, 65536u);
  EXPECT_EQ(wrapped.missed, 0u);
  EXPECT_FALSE(wrapped.jumped);
  const auto gap = ids.add(4, 10);
  EXPECT_EQ(gap.id, 65539u);
  EXPECT_EQ(gap.missed, 2u);
}

TEST(FrameIdUnwrap, CountsAcrossAWrapWhatItMissed) {
  FrameIdUnwrap ids;
  (void)ids.add(65534, 10);
  const auto step = ids.add(2, 10);
  EXPECT_EQ(step.id, 65537u);
  EXPECT_EQ(step.missed, 2u);
}

TEST(FrameIdUnwrap, TakesAnImpossibleGapAsAJumpAndContinuesByOne) {
  FrameIdUnwrap ids;
  (void)ids.add(100, 10);
  const auto jump = ids.add(65530, 10);
  EXPECT_EQ(jump.id, 101u);
  EXPECT_EQ(jump.missed, 0u);
  EXPECT_TRUE(jump.jumped);
  EXPECT_EQ(ids.add(65531, 10).id, 102u);
  const auto again = ids.add(65531, 10);  // a new exposure under the same id
  EXPECT_EQ(again.id, 103u);
  EXPECT_TRUE(again.jumped);
}

TEST(FrameIdUnwrap, ContinuesItsNumbersWhenTheCameraStartsAgain) {
  FrameIdUnwrap ids;
  (void)ids.add(500, 10);
  ids.restart();
  const auto step = ids.add(1, 10);
  EXPECT_EQ(step.id, 501u);
  EXPECT_FALSE(step.jumped);
}

TEST(FrameIdUnwrap, TakesIdsOf64BitsAsTheyAre) {
  FrameIdUnwrap ids;
  (void)ids.add(std::uint64_t{1} << 40, 10);
  const auto step = ids.add((std::uint64_t{1} << 40) + 3, 10);
  EXPECT_EQ(step.id, (std::uint64_t{1} << 40) + 3);
  EXPECT_EQ(step.missed, 2u);
}

// A camera with a clock that is `ppm` fast and showed `zero_ns` at kUtc.
struct DriftingClock {
  double ppm = 0;
  std::int64_t zero_ns = 0;
  [[nodiscard]] std::int64_t at(std::int64_t since_ns) const {
    return zero_ns + since_ns + static_cast<std::int64_t>(static_cast<double>(since_ns) * ppm * 1e-6);
  }
};

TEST(CameraClockMap, FollowsReadingsOfADriftingClockForHours) {
  for (const double ppm : {-100.0, 50.0, 100.0}) {
    std::mt19937 random(1);
    std::uniform_int_distribution<std::int64_t> trip(0, kMs);
    const DriftingClock device{ppm, 77 * kS};
    CameraClockMap map;
    double worst_s = 0;
    std::int64_t next_reading = 0;
    for (std::int64_t t = 0; t < 5 * 3600 * kS; t += kS / 2) {
      if (t >= next_reading) {
        // A latch happens somewhere within its round trip.
        const std::int64_t there = trip(random), back = trip(random);
        map.addReading(device.at(t + there), kUtc + t + (there + back) / 2, (there + back) / 2);
        next_reading = t + 10 * kS;
      }
      const std::int64_t utc = map.utcNs(device.at(t), kUtc + t + 20 * kMs + trip(random));
      worst_s = std::max(worst_s, std::abs(static_cast<double>(utc - kUtc - t)) * 1e-9);
    }
    EXPECT_LT(worst_s, 1.5e-3) << ppm << " ppm";
    EXPECT_NEAR(map.drift(), -ppm * 1e-6, 3e-6);
    EXPECT_EQ(map.resets(), 0u);
    EXPECT_EQ(map.clamped(), 0u);
  }
}

TEST(CameraClockMap, FollowsTheLeastDelayOfArrivalsWithoutReadings) {
  for (const double ppm : {-80.0, 80.0}) {
    std::mt19937 random(2);
    std::exponential_distribution<double> queue(1 / 3e-3);  // delays that a switch adds [s]
    const DriftingClock device{ppm, 0};
    CameraClockMap map(CameraClockMap::Mode::kFree, 6 * kMs);
    double worst_s = 0;
    for (std::int64_t t = 0; t < 3600 * kS; t += kS / 2) {
      std::int64_t delay = 6 * kMs + static_cast<std::int64_t>(queue(random) * 1e9);
      if (t % (60 * kS) == 0 && t > 0) delay += 700 * kMs;  // a packet held up
      const std::int64_t utc = map.utcNs(device.at(t), kUtc + t + delay);
      if (t > 60 * kS) worst_s = std::max(worst_s, std::abs(static_cast<double>(utc - kUtc - t)) * 1e-9);
    }
    EXPECT_LT(worst_s, 3e-3) << ppm << " ppm";
    EXPECT_EQ(map.resets(), 0u);
    EXPECT_EQ(map.clamped(), 0u);
  }
}

TEST(CameraClockMap, RestartsWhenTheClockDoes) {
  for (const bool readings : {false, true}) {
    CameraClockMap map;
    const auto frame = [&](std::int64_t device, std::int64_t t) {
      return map.utcNs(device, kUtc + t + 5 * kMs);
    };
    if (readings) map.addReading(500 * kS, kUtc, 100'000);
    std::int64_t last = 0;
    for (std::int64_t t = 0; t < 20 * kS; t += kS / 2) last = frame(500 * kS + t, t);
    // Away for four seconds, then from zero.
    if (readings) map.addReading(kS, kUtc + 24 * kS, 100'000);
    EXPECT_EQ(map.settled(), !readings || map.resets() == 1);
    for (std::int64_t t = 24 * kS + kS / 2; t < 30 * kS; t += kS / 2) {
      const std::int64_t utc = frame(kS + t - 24 * kS, t);
      EXPECT_GT(utc, last);
      EXPECT_NEAR(static_cast<double>(utc - kUtc - t), 0, 6e6);
      last = utc;
    }
    EXPECT_EQ(map.resets(), 1u);
    EXPECT_TRUE(map.settled());
  }
}

TEST(CameraClockMap, IsNotSettledByOneLateArrival) {
  CameraClockMap map;
  (void)map.utcNs(kS, kUtc + 400 * kMs);  // held up
  EXPECT_FALSE(map.settled());
  for (int i = 1; i < 5; ++i) (void)map.utcNs(kS + i * 500 * kMs, kUtc + i * 500 * kMs + kMs);
  EXPECT_TRUE(map.settled());
  EXPECT_NEAR(static_cast<double>(map.utcNs(kS + 2500 * kMs, kUtc + 2501 * kMs) - kUtc), 2501e6, 1e3);
}

TEST(CameraClockMap, KeepsItsReadingsThroughFramesThatComeSecondsLate) {
  CameraClockMap map;
  map.addReading(kS, kUtc, 100'000);
  for (int i = 1; i < 40; ++i) {
    const std::int64_t t = i * kS / 2;
    EXPECT_NEAR(static_cast<double>(map.utcNs(kS + t, kUtc + t + 3 * kS) - kUtc - t), 0, 1e3);
  }
  EXPECT_EQ(map.resets(), 0u);
  EXPECT_TRUE(map.settled());
}

TEST(CameraClockMap, IsUnsettledAfterAnImpossibleArrivalUntilTheNextReading) {
  CameraClockMap map;
  map.addReading(kS, kUtc, 100'000);
  (void)map.utcNs(kS + kS / 2, kUtc + kS / 2);
  (void)map.utcNs(9 * kS, kUtc + kS);  // stamped seven seconds ahead
  EXPECT_FALSE(map.settled());
  map.addReading(9 * kS, kUtc + kS, 100'000);
  EXPECT_TRUE(map.settled());
  EXPECT_EQ(map.resets(), 1u);
}

TEST(CameraClockMap, NoticesARestartWhileItWasAwayEvenIfTheNewClockIsAhead) {
  CameraClockMap map;
  for (int i = 0; i < 10; ++i) (void)map.utcNs(i * kS / 2, kUtc + i * kS / 2);
  map.reopened();
  // Started 20 s ago, away for 100 s.
  for (int i = 0; i < 10; ++i) (void)map.utcNs(20 * kS + i * kS / 2, kUtc + 100 * kS + i * kS / 2);
  EXPECT_EQ(map.resets(), 1u);
  EXPECT_TRUE(map.settled());
  EXPECT_NEAR(static_cast<double>(map.utcNs(25 * kS, kUtc + 105 * kS) - kUtc), 105e9, 1e6);
}

TEST(CameraClockMap, NoticesALeapAheadOfTheClock) {
  CameraClockMap map;
  for (int i = 0; i < 20; ++i) (void)map.utcNs(i * kS / 2, kUtc + i * kS / 2);
  // Frames that would have come 10 s before their exposure.
  for (int i = 20; i < 40; ++i) {
    const std::int64_t utc = map.utcNs(10 * kS + i * kS / 2, kUtc + i * kS / 2);
    EXPECT_NEAR(static_cast<double>(utc - kUtc - i * kS / 2), 0, 1e6);
  }
  EXPECT_EQ(map.resets(), 1u);
}

TEST(CameraClockMap, TakesPtpStampsAsTimeOfDayInUtcOrTaiAndSaysWhenTheyAreNot) {
  constexpr std::int64_t kTai = 37 * kS;
  CameraClockMap utc(CameraClockMap::Mode::kPtp), tai(CameraClockMap::Mode::kPtp),
      none(CameraClockMap::Mode::kPtp);
  for (int i = 0; i < 10; ++i) {
    const std::int64_t t = kUtc + i * kS / 2;
    EXPECT_EQ(utc.utcNs(t, t + 30 * kMs), t);
    EXPECT_EQ(tai.utcNs(t + kTai, t + 30 * kMs), t);
    EXPECT_NEAR(static_cast<double>(none.utcNs(i * kS / 2, t + 30 * kMs) - t), 30e6, 1e6);
  }
  EXPECT_EQ(utc.unsynchronised() + tai.unsynchronised(), 0u);
  EXPECT_EQ(none.unsynchronised(), 10u);
}

TEST(CameraClockMap, PtpStampsAreUtcAlsoWhereTheVehiclesTimeIsNot) {
  // A dive that was begun with the clock 0.4 s ahead, and one with it a day behind.
  for (const std::int64_t error : {400 * kMs, -86'400 * kS}) {
    CameraClockMap map(CameraClockMap::Mode::kPtp);
    for (int i = 0; i < 10; ++i) {
      const std::int64_t utc = kUtc + i * kS / 2, vehicle = utc + error;
      EXPECT_EQ(map.utcNs(utc, vehicle + 30 * kMs, error), vehicle);
    }
    EXPECT_EQ(map.unsynchronised(), 0u);
  }
}

TEST(CameraClockMap, SurvivesAnyStamps) {
  std::mt19937_64 random(9);
  CameraClockMap map;
  std::int64_t last = INT64_MIN;
  for (int i = 0; i < 10'000; ++i) {
    const auto device = static_cast<std::int64_t>(random());
    if (i % 7 == 0) map.addReading(device, kUtc + i * kMs, static_cast<std::int64_t>(random() >> 40));
    const std::int64_t utc = map.utcNs(static_cast<std::int64_t>(random()), kUtc + i * kMs);
    EXPECT_GT(utc, last);
    last = utc;
  }
}

MissionConfig mission() {
  MissionConfig mission;
  mission.cameras.left_serial = "A1";
  mission.cameras.right_serial = "B2";
  return mission;
}

StereoCameraConfig configOf(const std::string& text) {
  const ConfigTable root = ConfigTable::parse(text, "onboard.toml");
  const ConfigTable cameras = root.table("cameras");
  const StereoCameraConfig config =
      readKeys(cameras, StereoCameraConfig{},
               [](KeyVisitor& keys, StereoCameraConfig& c) { visitCameras(keys, c, mission()); });
  root.finish();
  return config;
}

TEST(FirstFrameWait, ACameraThatNeverBeginsIsOpenedAgainAtGrowingIntervals) {
  FirstFrameWait wait(5 * kS);
  EXPECT_FALSE(wait.overdue(100 * kS)) << "nothing is open";
  std::int64_t now = 0;
  for (const std::int64_t given : {5, 10, 20, 40, 60, 60}) {
    wait.opened(now);
    EXPECT_FALSE(wait.overdue(now + given * kS)) << given;
    EXPECT_TRUE(wait.overdue(now + given * kS + 1)) << given;
    EXPECT_FALSE(wait.overdue(now + given * kS + 2)) << "once an opening";
    now += 100 * kS;
  }
  wait.opened(now);
  wait.frameCame();
  EXPECT_FALSE(wait.overdue(now + 1000 * kS));
  wait.opened(now);
  EXPECT_TRUE(wait.overdue(now + 5 * kS + 1)) << "starts again after a frame";
}

TEST(CameraConfig, TakesFormatsAndRateFromTheMissionWhenTheyAreNotGiven) {
  const StereoCameraConfig none = configOf("");
  EXPECT_FALSE(none.used());
  const StereoCameraConfig config = configOf("[cameras]\nleft = \"A1\"\nright = \"B2\"\n");
  EXPECT_TRUE(config.used());
  EXPECT_EQ(config.side[0].format.name, "BayerRG12Packed");
  EXPECT_EQ(config.side[1].format.name, "Mono12Packed");
  EXPECT_EQ(config.side[0].rate_hz, 2);
  EXPECT_EQ(config.side[0].trigger, CameraTrigger::kFreeRun);
}

TEST(CameraConfig, ReadsEveryKey) {
  const StereoCameraConfig config = configOf(
      "[cameras]\nleft = \"10.0.0.2\"\nright = \"Vendor-B2\"\nleft_format = \"BayerRG12\"\nright_format = "
      "\"Mono12\"\nwidth = 680\nheight = 512\nexposure_us = 4000\ngain_db = 6\npacket_size = "
      "8000\npacket_delay_ns = 2000\ntrigger = \"line\"\ntrigger_line = \"Line2\"\ntrigger_activation = "
      "\"FallingEdge\"\nrate_hz = 4\nbuffers = 6\npool_frames = 9\ninterface = \"eth1\"\npacket_socket = "
      "true\nreceive_priority = 30\nstamp_to_packet_ms = 12.5\n");
  const CameraConfig& right = config.side[1];
  EXPECT_EQ(right.id, "Vendor-B2");
  EXPECT_EQ(right.side, CameraSide::kRight);
  EXPECT_EQ(right.format.name, "Mono12");
  EXPECT_EQ(right.width, 680);
  EXPECT_EQ(right.height, 512);
  EXPECT_EQ(right.exposure_us, 4000);
  EXPECT_EQ(right.gain_db, 6);
  EXPECT_EQ(right.packet_size, 8000);
  EXPECT_EQ(right.packet_delay_ns, 2000);
  EXPECT_EQ(right.trigger, CameraTrigger::kLine);
  EXPECT_EQ(right.trigger_line, "Line2");
  EXPECT_EQ(right.trigger_activation, "FallingEdge");
  EXPECT_EQ(right.rate_hz, 4);
  EXPECT_EQ(right.buffers, 6u);
  EXPECT_EQ(right.pool_frames, 9u);
  EXPECT_EQ(right.interface, "eth1");
  EXPECT_TRUE(right.packet_socket);
  EXPECT_EQ(right.receive_priority, 30);
  EXPECT_EQ(right.stamp_to_packet_ms, 12.5);
}

TEST(CameraConfig, RefusesWhatCannotBeWithALineThatSaysWhy) {
  const auto refusal = [](const std::string& text) {
    return test::refusal([&] { (void)configOf("[cameras]\n" + text); });
  };
  EXPECT_NE(refusal("left = \"A\"\nright = \"A\"\n").find("same camera"), std::string::npos);
  EXPECT_NE(refusal("left = \"A\"\n").find("right"), std::string::npos);
  EXPECT_NE(refusal("left = \"A\"\nright = \"B\"\nleft_format = \"Mono8\"\n").find("mission.toml"),
            std::string::npos);
  EXPECT_NE(refusal("left_format = \"YUV\"\n").find("left_format"), std::string::npos);
  EXPECT_NE(refusal("packet_size = 100\n").find("576"), std::string::npos);
  EXPECT_NE(refusal("trigger = \"magic\"\n").find("trigger"), std::string::npos);
  EXPECT_NE(refusal("exposure = 3\n").find("exposure"), std::string::npos);
}

TEST(CameraConfig, NamesSwappedAndForeignCameras) {
  EXPECT_EQ(serialMismatch(mission(), "A1", "B2"), "");
  EXPECT_NE(serialMismatch(mission(), "B2", "A1").find("swapped"), std::string::npos);
  EXPECT_NE(serialMismatch(mission(), "A1", "C3").find("right camera is C3"), std::string::npos);
  EXPECT_NE(serialMismatch(mission(), "C3", "B2").find("left camera is C3"), std::string::npos);
}

}  // namespace
}  // namespace fathom::io

#include "sim/hil/players/pd0_encoder.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"

namespace fathom::sim {
namespace {

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

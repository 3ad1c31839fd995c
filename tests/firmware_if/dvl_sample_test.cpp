#include <gtest/gtest.h>

#include <random>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"
#include "realtime/base/units.hpp"
#include "tests/firmware_if/pd0_builder.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

Pd0Ensemble ensembleIn(Pd0Frame frame, const Eigen::Vector4d& velocity) {
  Pd0Ensemble out;
  out.utc_ns = 1;
  out.frame = frame;
  out.beam_angle = M_PI / 6;
  out.heading_deg = 0;
  out.pitch_deg = 0;
  out.roll_deg = 0;
  out.bottom_track.emplace();
  for (std::size_t i = 0; i < 4; ++i) out.bottom_track->velocity[i] = velocity[static_cast<Eigen::Index>(i)];
  return out;
}

TEST(DvlSample, ShipVelocityBecomesTheVehiclesOwnInForwardStarboardDown) {
  // The bottom moves aft at 1.5 m/s, to port at 0.1 m/s and comes up at 0.2 m/s.
  const auto sample = toDvlSample(ensembleIn(Pd0Frame::kShip, {-0.1, -1.5, 0.2, 0}));
  ASSERT_TRUE(sample && sample->velocity);
  EXPECT_TRUE(sample->velocity->isApprox(Eigen::Vector3d(1.5, 0.1, 0.2), 1e-12));
}

TEST(DvlSample, BeamVelocitiesGiveTheVelocityThatTheyAreProjectionsOf) {
  // Each beam sees the bottom's velocity along itself, positive towards the transducer; beams 1 port, 2
  // starboard, 3 forward, 4 aft, 30 degrees from straight down.
  const Eigen::Vector3d own(1.4, -0.3, 0.25);  // forward, starboard, down
  const double s = std::sin(M_PI / 6);
  const double c = std::cos(M_PI / 6);
  const std::array<Eigen::Vector3d, 4> beam = {Eigen::Vector3d{0, -s, c}, {0, s, c}, {s, 0, c}, {-s, 0, c}};
  Eigen::Vector4d measured;
  for (Eigen::Index i = 0; i < 4; ++i) measured[i] = own.dot(beam[static_cast<std::size_t>(i)]);
  const auto sample = toDvlSample(ensembleIn(Pd0Frame::kBeam, measured));
  ASSERT_TRUE(sample && sample->velocity);
  EXPECT_TRUE(sample->velocity->isApprox(own, 1e-12)) << sample->velocity->transpose();
}

TEST(DvlSample, EarthVelocityIsTurnedBackByHeadingPitchAndRoll) {
  Pd0Ensemble ensemble = ensembleIn(Pd0Frame::kEarth, {-1.0, 0.0, 0.0, 0});  // the vehicle goes east at 1 m/s
  ensemble.heading_deg = 90;
  EXPECT_TRUE(toDvlSample(ensemble)->velocity->isApprox(Eigen::Vector3d(1, 0, 0), 1e-12));
  ensemble.heading_deg = 0;
  EXPECT_TRUE(toDvlSample(ensemble)->velocity->isApprox(Eigen::Vector3d(0, 1, 0), 1e-12));
  // Nose up 30 degrees and level flight to the north: part of it points down in the vehicle's frame.
  ensemble = ensembleIn(Pd0Frame::kEarth, {0, -1.0, 0, 0});
  ensemble.pitch_deg = 30;
  EXPECT_TRUE(toDvlSample(ensemble)->velocity->isApprox(
      Eigen::Vector3d(std::cos(M_PI / 6), 0, std::sin(M_PI / 6)), 1e-12));
}

TEST(DvlSample, AltitudeOverAFlatBottomIsExactAtAnyTilt) {
  // Ranges along the instrument's axis, from the geometry: slant = altitude / (direction . down), range =
  // slant cos a.
  const double altitude = 2.5;
  for (const double pitch : {-20.0, 0.0, 15.0}) {
    for (const double roll : {-10.0, 0.0, 12.0}) {
      Pd0Ensemble ensemble = ensembleIn(Pd0Frame::kShip, {0, 0, 0, 0});
      ensemble.pitch_deg = pitch;
      ensemble.roll_deg = roll;
      const double r = degreesToRadians(roll);
      const double p = std::atan(std::tan(degreesToRadians(pitch)) * std::cos(r));
      const Eigen::Vector3d down(-std::sin(p), std::cos(p) * std::sin(r), std::cos(p) * std::cos(r));
      const double s = std::sin(M_PI / 6);
      const double c = std::cos(M_PI / 6);
      const std::array<Eigen::Vector3d, 4> beam = {
          Eigen::Vector3d{0, -s, c}, {0, s, c}, {s, 0, c}, {-s, 0, c}};
      for (std::size_t i = 0; i < 4; ++i) ensemble.bottom_track->range[i] = altitude / beam[i].dot(down) * c;
      EXPECT_NEAR(*toDvlSample(ensemble)->altitude, altitude, 1e-12) << pitch << " " << roll;
      ensemble.bottom_track->range[2].reset();  // one pair is enough
      EXPECT_NEAR(*toDvlSample(ensemble)->altitude, altitude, 1e-12);
      ensemble.bottom_track->range[0].reset();
      EXPECT_FALSE(toDvlSample(ensemble)->altitude);
    }
  }
}

TEST(DvlSample, AMissingComponentIsAMissingVelocityAndNeverZero) {
  Pd0Ensemble ensemble = ensembleIn(Pd0Frame::kInstrument, {0, -1, 0, 0});
  ensemble.bottom_track->velocity[2].reset();
  EXPECT_FALSE(toDvlSample(ensemble)->velocity);
  ensemble.utc_ns.reset();
  EXPECT_FALSE(toDvlSample(ensemble));
}

TEST(DvlSample, AnUpLookingProfileHeadLeavesShipVelocityButNotThatOfItsOwnAxes) {
  Pd0Ensemble ensemble = ensembleIn(Pd0Frame::kShip, {0, -1, 0, 0});
  ensemble.up_looking = true;
  EXPECT_TRUE(toDvlSample(ensemble)->velocity);
  ensemble.frame = Pd0Frame::kInstrument;
  EXPECT_FALSE(toDvlSample(ensemble)->velocity);
}

TEST(DvlSample, OnARealDiveTheVelocityExplainsTheChangeOfAltitude) {
  FATHOM_REQUIRE_DATA("dvl/adcp.adc");
  const std::vector<std::uint8_t> bytes = test::readBytes(test::dataFile("dvl/adcp.adc"));
  Pd0Decoder decoder;
  std::optional<Pd0Ensemble> last;
  double sum_squares = 0;
  double rate_squares = 0;
  double forward = 0;
  int pairs = 0;
  const auto downRate = [](const Pd0Ensemble& ensemble, const DvlSample& sample) {
    const double pitch = degreesToRadians(*ensemble.pitch_deg);
    return sample.velocity->z() * std::cos(pitch) - sample.velocity->x() * std::sin(pitch);
  };
  decoder.feed(bytes, [&](const Pd0Ensemble& ensemble) {
    const auto a = last ? toDvlSample(*last) : std::nullopt;
    const auto b = toDvlSample(ensemble);
    if (a && b && a->velocity && b->velocity && a->altitude && b->altitude) {
      const double dt = static_cast<double>(b->utc_ns - a->utc_ns) * 1e-9;
      const double rate = (*b->altitude - *a->altitude) / dt;
      if (dt > 0 && dt < 5 && std::abs(rate) < 1) {
        sum_squares += std::pow(rate + (downRate(*last, *a) + downRate(ensemble, *b)) / 2, 2);
        rate_squares += rate * rate;
        forward += b->velocity->x();
        ++pairs;
      }
    }
    last = ensemble;
  });
  ASSERT_GT(pairs, 3000);
  // The rest is the seafloor's own relief. With a wrong sign, axis or levelling it exceeds the rate itself.
  EXPECT_LT(std::sqrt(sum_squares / pairs), 0.5 * std::sqrt(rate_squares / pairs));
  EXPECT_GT(forward / pairs, 1.0) << "the vehicle flies forward";
}

using Bytes = std::vector<std::uint8_t>;
using test::Pd0Builder;

Bytes ensembleBytes(std::uint32_t number) {
  Pd0Builder builder;
  builder.number = number;
  return builder.bytes();
}

void append(Bytes& out, const Bytes& more) {
  out.insert(out.end(), more.begin(), more.end());
}

std::vector<Pd0Ensemble> decode(Pd0Decoder& decoder, const Bytes& bytes, std::size_t piece = 1 << 20) {
  std::vector<Pd0Ensemble> out;
  const auto keep = [&](const Pd0Ensemble& ensemble) { out.push_back(ensemble); };
  for (std::size_t at = 0; at < bytes.size(); at += piece)
    decoder.feed(std::span(bytes).subspan(at, std::min(piece, bytes.size() - at)), keep);
  decoder.drain(keep);
  return out;
}

std::vector<std::uint32_t> numbers(const std::vector<Pd0Ensemble>& ensembles) {
  std::vector<std::uint32_t> out;
  for (const auto& ensemble : ensembles) out.push_back(ensemble.number);
  return out;
}

Pd0Ensemble decodeOne(const Pd0Builder& builder) {
  Pd0Decoder decoder;
  const auto ensembles = decode(decoder, builder.bytes());
  EXPECT_EQ(ensembles.size(), 1U);
  return ensembles.empty() ? Pd0Ensemble{} : ensembles.front();
}

TEST(Pd0Decoder, NothingComesOutOfNothing) {
  Pd0Decoder decoder;
  EXPECT_TRUE(decode(decoder, {}).empty());
  EXPECT_EQ(decoder.counts().skipped_bytes, 0U);
}

TEST(Pd0Decoder, TheSameEnsemblesComeOutHoweverTheBytesAreCut) {
  Bytes stream;
  for (std::uint32_t n = 1; n <= 40; ++n) append(stream, ensembleBytes(n));
  Pd0Decoder whole;
  const auto expected = numbers(decode(whole, stream));
  ASSERT_EQ(expected.size(), 40U);
  for (const std::size_t piece : {1U, 2U, 7U, 333U, 4096U}) {
    Pd0Decoder decoder;
    EXPECT_EQ(numbers(decode(decoder, stream, piece)), expected) << "pieces of " << piece;
    EXPECT_EQ(decoder.counts().skipped_bytes, 0U);
    EXPECT_EQ(decoder.counts().resynced, 0U);
  }
}

TEST(Pd0Decoder, AnEnsembleComesOutWithItsLastByteAndNotBefore) {
  const Bytes bytes = ensembleBytes(5);
  Pd0Decoder decoder;
  ASSERT_EQ(decoder.accept(std::span(bytes).first(bytes.size() - 1)), bytes.size() - 1);
  EXPECT_EQ(decoder.next(), nullptr);
  ASSERT_EQ(decoder.accept(std::span(bytes).last(1)), 1U);
  ASSERT_NE(decoder.next(), nullptr);
  EXPECT_TRUE(std::ranges::equal(decoder.rawEnsemble(), bytes)) << "raw bytes are for the recorder";
  EXPECT_EQ(decoder.next(), nullptr);
}

TEST(Pd0Decoder, ADamagedEnsembleCostsOnlyItself) {
  Bytes stream = ensembleBytes(1);
  const std::size_t damaged_begin = stream.size();
  append(stream, ensembleBytes(2));
  const std::size_t damaged_size = stream.size() - damaged_begin;
  append(stream, ensembleBytes(3));
  // Every byte of the middle ensemble in turn, header, length and checksum included.
  for (std::size_t at = damaged_begin; at < damaged_begin + damaged_size; ++at) {
    Bytes damaged = stream;
    damaged[at] ^= 0x40;
    Pd0Decoder decoder;
    EXPECT_EQ(numbers(decode(decoder, damaged)), (std::vector<std::uint32_t>{1, 3})) << "byte " << at;
    EXPECT_EQ(decoder.counts().resynced, 1U);
    EXPECT_EQ(decoder.counts().skipped_bytes, damaged_size);
    EXPECT_LE(decoder.counts().bad_checksum, 1U);
  }
}

TEST(Pd0Decoder, ALostPieceOfAnEnsembleDoesNotTakeTheNextOneAlong) {
  Bytes stream = ensembleBytes(1);
  const Bytes cut = ensembleBytes(2);
  stream.insert(stream.end(), cut.begin(), cut.begin() + 100);
  append(stream, ensembleBytes(3));
  Pd0Decoder decoder;
  EXPECT_EQ(numbers(decode(decoder, stream)), (std::vector<std::uint32_t>{1, 3}));
  EXPECT_EQ(decoder.counts().skipped_bytes, 100U);
}

TEST(Pd0Decoder, AnInputThatEndsInsideAnEnsembleIsCountedAsTruncated) {
  Bytes stream = ensembleBytes(1);
  const Bytes cut = ensembleBytes(2);
  stream.insert(stream.end(), cut.begin(), cut.end() - 1);
  Pd0Decoder decoder;
  EXPECT_EQ(numbers(decode(decoder, stream)), (std::vector<std::uint32_t>{1}));
  EXPECT_EQ(decoder.counts().truncated, 1U);
  EXPECT_EQ(decoder.counts().resynced, 0U);
}

TEST(Pd0Decoder, AChecksumThatIsRightOverNonsenseIsCountedAndGivesNothing) {
  Pd0Builder builder;
  Pd0Decoder decoder;
  EXPECT_TRUE(decode(decoder, Pd0Builder::assemble({builder.bottomTrack()})).empty());
  EXPECT_EQ(decoder.counts().malformed, 1U);
  EXPECT_EQ(decoder.counts().good, 0U);
}

TEST(Pd0Decoder, RandomBytesGiveNoEnsembleAndAreAllSkipped) {
  std::mt19937 random(7);
  Bytes noise(200'000);
  // Mostly header bytes, to make the search work.
  for (auto& byte : noise)
    byte = random() % 4 == 0 ? static_cast<std::uint8_t>(random()) : std::uint8_t{0x7F};
  Pd0Decoder decoder;
  EXPECT_TRUE(decode(decoder, noise, 1000).empty());
  EXPECT_EQ(decoder.counts().skipped_bytes, noise.size());
}

TEST(Pd0Decoder, DecodingAllocatesNothing) {
  Bytes stream;
  for (std::uint32_t n = 1; n <= 200; ++n) append(stream, ensembleBytes(n));
  stream[5000] ^= 1;
  Pd0Decoder decoder;
  const auto before = test::threadCost();
  decoder.feed(stream, [](const Pd0Ensemble&) {});
  decoder.drain([](const Pd0Ensemble&) {});
  EXPECT_EQ(test::threadCost().heap_calls - before.heap_calls, 0U);
  EXPECT_EQ(decoder.counts().good, 199U);
}

TEST(Pd0Fields, AbsentVelocitiesAndRangesAreAbsentAndNotNumbers) {
  Pd0Builder builder;
  builder.velocity = {-32768, 5, -6, 7};
  builder.range = {0, 1, 2, 3};
  const Pd0Ensemble ensemble = decodeOne(builder);
  ASSERT_TRUE(ensemble.bottom_track);
  EXPECT_FALSE(ensemble.bottom_track->velocity[0]);
  EXPECT_DOUBLE_EQ(*ensemble.bottom_track->velocity[2], -0.006);
  EXPECT_FALSE(ensemble.bottom_track->range[0]);
  EXPECT_DOUBLE_EQ(*ensemble.bottom_track->range[3], 0.03);
  EXPECT_FALSE(ensemble.hasBottomTrackVelocity());
  builder.bottom_track = false;
  EXPECT_FALSE(decodeOne(builder).bottom_track);
}

TEST(Pd0Fields, RangesHave24Bits) {
  Pd0Builder builder;
  builder.range = {0x010000, 0x0186A0, 0xFFFFFF, 65535};
  const auto range = decodeOne(builder).bottom_track->range;
  EXPECT_DOUBLE_EQ(*range[0], 655.36);
  EXPECT_DOUBLE_EQ(*range[1], 1000.0);
  EXPECT_DOUBLE_EQ(*range[2], 167772.15);
  EXPECT_DOUBLE_EQ(*range[3], 655.35);
}

TEST(Pd0Fields, TheEnsembleNumberHas24Bits) {
  Pd0Builder builder;
  builder.number = 0x030201;
  EXPECT_EQ(decodeOne(builder).number, 0x030201U);
}

TEST(Pd0Fields, TheFrameIsThatOfTheTransformByte) {
  Pd0Builder builder;
  const std::array<const char*, 4> names = {"beam", "instrument", "ship", "earth"};
  for (std::uint8_t code = 0; code < 4; ++code) {
    builder.transform = static_cast<std::uint8_t>((code << 3) | 0x03);
    EXPECT_STREQ(frameName(decodeOne(builder).frame), names[code]);
    EXPECT_FALSE(decodeOne(builder).tilts_used);
  }
}

TEST(Pd0Fields, BothClocksGiveUtc) {
  Pd0Builder builder;  // 2014-12-19 17:17:55.94
  EXPECT_EQ(decodeOne(builder).utc_ns, 1'419'009'475'940'000'000);
  builder.clock_with_century = {20, 33, 5, 18, 3, 33, 20, 7};  // 2033-05-18 03:33:20.07
  EXPECT_EQ(decodeOne(builder).utc_ns, 2'000'000'000'070'000'000);
  builder.clock_with_century = {20, 33, 13, 18, 3, 33, 20, 7};  // no such month: the old clock still holds
  EXPECT_EQ(decodeOne(builder).utc_ns, 1'419'009'475'940'000'000);
  builder.clock = {99, 12, 31, 23, 59, 59, 99};
  EXPECT_EQ(decodeOne(builder).utc_ns, 946'684'799'990'000'000);
}

TEST(Pd0Fields, AnImpossibleDateIsAnAbsentTime) {
  Pd0Builder builder;
  builder.clock = {15, 2, 29, 0, 0, 0, 0};
  EXPECT_FALSE(decodeOne(builder).utc_ns);
  builder.clock = {16, 2, 29, 0, 0, 0, 0};
  EXPECT_TRUE(decodeOne(builder).utc_ns);
  builder.clock = {16, 2, 28, 24, 0, 0, 0};
  EXPECT_FALSE(decodeOne(builder).utc_ns);
}

TEST(Pd0Fields, AttitudeOutOfRangeIsAbsent) {
  Pd0Builder builder;
  builder.heading = 36000;
  builder.pitch = -32768;
  builder.roll = -1234;
  builder.sound_speed = 0;
  const Pd0Ensemble ensemble = decodeOne(builder);
  EXPECT_FALSE(ensemble.heading_deg);
  EXPECT_FALSE(ensemble.pitch_deg);
  EXPECT_DOUBLE_EQ(*ensemble.roll_deg, -12.34);
  EXPECT_FALSE(ensemble.sound_speed);
}

}  // namespace
}  // namespace fathom::io

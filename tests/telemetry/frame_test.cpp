#include "telemetry/wire/frame.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "realtime/base/bytes/crc32.hpp"
#include "tests/telemetry/sample_frames.hpp"

namespace fathom::telemetry {
namespace {

TEST(Frame, RoundTripsAtEverySize) {
  for (std::size_t payload = 0; payload <= kMaxFrameBytes - kFrameOverhead; ++payload) {
    const auto bytes = countingFrame(static_cast<std::uint16_t>(60000 + payload), payload);
    ASSERT_EQ(bytes.size(), payload + kFrameOverhead);
    const DecodedFrame frame = decodeFrame(bytes);
    ASSERT_EQ(frame.verdict, FrameVerdict::kAccepted);
    EXPECT_EQ(frame.header.identity, kOurs);
    EXPECT_EQ(frame.header.sequence(), 60000 + payload);
    EXPECT_EQ(frame.header.type, MessageType::kTrack);
    ASSERT_EQ(frame.payload.size(), payload);
    if (payload > 0) {
      EXPECT_EQ(frame.payload[0], static_cast<std::uint8_t>(60000 + payload));
    }
  }
}

TEST(Frame, CarriesTheTurnBesideTheType) {
  std::vector<std::uint8_t> out(kMaxFrameBytes);
  for (const bool turn : {false, true}) {
    const std::size_t size = encodeFrame({kOurs, 1, MessageType::kDownlink, turn}, {}, out);
    const DecodedFrame frame = decodeFrame(std::span(out).first(size));
    EXPECT_EQ(frame.header.turn, turn);
    EXPECT_EQ(frame.header.type, MessageType::kDownlink);
  }
}

TEST(Frame, IsNotEncodedWhenItDoesNotFit) {
  std::vector<std::uint8_t> body(kMaxFrameBytes - kFrameOverhead + 1), out(1000);
  EXPECT_EQ(encodeFrame({kOurs, 1, MessageType::kStatus}, body, out), 0U);
  EXPECT_EQ(
      encodeFrame({kOurs, 1, MessageType::kStatus}, std::span(body).first(10), std::span(out).first(19)), 0U);
}

TEST(Frame, TruncatedAtAnyByteIsRejected) {
  const auto bytes = countingFrame(9, 40);
  for (std::size_t n = 0; n < bytes.size(); ++n) {
    const FrameVerdict verdict = decodeFrame(std::span(bytes).first(n)).verdict;
    EXPECT_EQ(verdict, n < kFrameOverhead ? FrameVerdict::kTooShort : FrameVerdict::kBadTag) << n;
  }
  EXPECT_EQ(decodeFrame(std::vector<std::uint8_t>(kMaxFrameBytes + 1)).verdict, FrameVerdict::kTooLong);
}

TEST(Frame, AnySingleFlippedBitIsRejected) {
  const auto good = countingFrame(77, 40);
  for (std::size_t bit = 0; bit < good.size() * 8; ++bit) {
    auto bytes = good;
    bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] ^ 1U << bit % 8);
    EXPECT_EQ(decodeFrame(bytes).verdict, FrameVerdict::kBadTag) << bit;
  }
}

// The last four bytes as every protocol before this one had them.
void endWithCrc(std::span<std::uint8_t> bytes) {
  const std::uint32_t crc = crc32(bytes.first(bytes.size() - 4));
  for (std::size_t i = 0; i < 4; ++i)
    bytes[bytes.size() - 4 + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
}

TEST(Frame, AnotherVersionIsNotDamageAndRecordingsOfTheVersionsBeforeAreRead) {
  for (const auto& [version, verdict] :
       {std::pair{1U, FrameVerdict::kVersion}, std::pair{2U, FrameVerdict::kAccepted},
        std::pair{3U, FrameVerdict::kAccepted}}) {
    auto bytes = countingFrame(300);
    bytes[0] = static_cast<std::uint8_t>((bytes[0] & 15U) | version << 4);
    EXPECT_EQ(decodeFrame(bytes).verdict, FrameVerdict::kBadTag) << version;
    endWithCrc(bytes);
    EXPECT_EQ(decodeFrame(bytes).verdict, verdict) << version;
    EXPECT_EQ(decodeFrame(bytes).header.sequence(), version == 1 ? 0 : 300);
  }
}

FrameTag keyed(std::uint8_t secret) {
  return FrameTag(keyOf(secret));
}

TEST(Frame, AKeyedFrameIsWholeOnlyWithItsKeyAndItsLap) {
  std::vector<std::uint8_t> out(kMaxFrameBytes), body(20, 7);
  const Version version = 0x4321'0042;
  out.resize(encodeFrame({kOurs, version, MessageType::kMapPacket}, body, out, keyed(1)));
  const std::array<std::uint16_t, 2> laps{0x4320, 0x4321}, others{0x4320, 0x4322};
  const DecodedFrame frame = decodeFrame(out, keyed(1), laps);
  EXPECT_EQ(frame.verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(frame.header.version, version);
  EXPECT_TRUE(frame.whole_version);
  EXPECT_EQ(decodeFrame(out, keyed(1), others).verdict, FrameVerdict::kBadTag);
  EXPECT_EQ(decodeFrame(out, keyed(2), laps).verdict, FrameVerdict::kBadTag);
  EXPECT_EQ(decodeFrame(out).verdict, FrameVerdict::kBadTag);
  for (std::size_t bit = 0; bit < out.size() * 8; ++bit) {
    auto bytes = out;
    bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] ^ 1U << bit % 8);
    ASSERT_NE(decodeFrame(bytes, keyed(1), laps).verdict, FrameVerdict::kAccepted) << bit;
  }
}

TEST(Frame, WhereAKeyIsAskedForNothingWithoutOneIsTakenHoweverOld) {
  auto bytes = countingFrame(5);
  const std::array<std::uint16_t, 1> laps{0};
  EXPECT_EQ(decodeFrame(bytes, keyed(1), laps).verdict, FrameVerdict::kUnkeyed);
  bytes[0] = static_cast<std::uint8_t>((bytes[0] & 15U) | 3U << 4);
  endWithCrc(bytes);
  EXPECT_EQ(decodeFrame(bytes, keyed(1), laps).verdict, FrameVerdict::kUnkeyed);
}

TEST(Frame, TheFirstVersionRisesFromDiveToDive) {
  constexpr std::int64_t kHour_ns = 3600 * kSecond_ns;
  for (int hours = 0; hours < 100; ++hours)
    EXPECT_GT(firstVersion(kStart_ns + (hours + 2) * kHour_ns), firstVersion(kStart_ns + hours * kHour_ns));
  for (const std::int64_t start_ns : {std::int64_t{0}, -kStart_ns, 2 * kStart_ns})
    EXPECT_GE(firstVersion(start_ns), 0x10000U);
}

}  // namespace
}  // namespace fathom::telemetry

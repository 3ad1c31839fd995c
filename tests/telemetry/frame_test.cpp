#include <gtest/gtest.h>

#include <random>

#include "realtime/base/bytes/crc32.hpp"
#include "telemetry/wire/field.hpp"
#include "telemetry/wire/frame.hpp"
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

Bytes linkFrame(std::uint16_t sequence, std::size_t payload_bytes) {
  const Bytes payload(payload_bytes, static_cast<std::uint8_t>(sequence));
  return frameWith({{3, 17}, sequence, MessageType::kTrack}, payload);
}

std::vector<Bytes> split(std::span<const std::uint8_t> modem_frame) {
  std::vector<Bytes> all;
  LinkFrames frames(modem_frame);
  while (const auto frame = frames.next()) all.emplace_back(frame->begin(), frame->end());
  return all;
}

// As many of the frames as there is room for, in a modem frame of `modem_bytes` at most.
Bytes joined(const std::vector<Bytes>& frames, std::size_t modem_bytes, bool padded) {
  Bytes out(modem_bytes, 0xAA);
  ModemFrameWriter writer(out, padded);
  for (const Bytes& frame : frames) {
    const auto room = writer.room();
    if (room.size() < frame.size()) break;
    std::copy(frame.begin(), frame.end(), room.begin());
    writer.add(frame.size());
  }
  out.resize(writer.finish());
  return out;
}

TEST(Bundle, OneLinkFrameGoesAsItIs) {
  const Bytes frame = linkFrame(1, 22);
  EXPECT_EQ(joined({frame}, 64, false), frame);
  EXPECT_EQ(split(frame), std::vector<Bytes>{frame});
  EXPECT_EQ(paddedBytes(frame), 0U);
}

TEST(Bundle, GivesBackTheLinkFramesThatWerePutIntoIt) {
  const std::vector<Bytes> frames = {linkFrame(1, 0), linkFrame(2, 22), linkFrame(3, 246), linkFrame(4, 5)};
  for (const bool padded : {false, true}) {
    const Bytes bundle = joined(frames, 600, padded);
    EXPECT_EQ(bundle.size(), padded ? 600U : 1U + (1 + 10) + (1 + 32) + (1 + 256) + (1 + 15));
    EXPECT_EQ(bundle[0], kBundleMark);
    EXPECT_EQ(split(bundle), frames);
    EXPECT_EQ(paddedBytes(bundle), padded ? 600U : 0U);
  }
}

TEST(Bundle, OnePaddedLinkFrameIsABundleToo) {
  const Bytes frame = linkFrame(1, 22);
  const Bytes bundle = joined({frame}, 64, true);
  EXPECT_EQ(bundle.size(), 64U);
  EXPECT_EQ(split(bundle), std::vector<Bytes>{frame});
  EXPECT_EQ(paddedBytes(bundle), 64U);
}

TEST(Bundle, HoldsNoMoreThanTheModemTakes) {
  const std::vector<Bytes> frames(10, linkFrame(1, 22));
  for (std::size_t modem_bytes = 64; modem_bytes < 340; ++modem_bytes)
    for (const bool padded : {false, true}) {
      const Bytes bundle = joined(frames, modem_bytes, padded);
      EXPECT_LE(bundle.size(), modem_bytes);
      EXPECT_EQ(split(bundle).size(), std::min<std::size_t>(10, (modem_bytes - 1) / 33)) << modem_bytes;
    }
}

TEST(Bundle, SaysBeforehandHowLongItWillBe) {
  Bytes out(300);
  ModemFrameWriter writer(out, false);
  for (const std::size_t payload : {5U, 22U, 100U}) {
    const Bytes frame = linkFrame(1, payload);
    const std::size_t predicted = writer.bytesWith(frame.size());
    std::copy(frame.begin(), frame.end(), writer.room().begin());
    writer.add(frame.size());
    EXPECT_EQ(writer.finish(), predicted);
  }
}

TEST(Bundle, CutShortItGivesTheLinkFramesThatAreWhole) {
  const std::vector<Bytes> frames = {linkFrame(1, 22), linkFrame(2, 22), linkFrame(3, 22)};
  const Bytes bundle = joined(frames, 200, false);
  for (std::size_t size = 0; size < bundle.size(); ++size) {
    // A heap block of exactly this size: the sanitizer sees a byte too many.
    const Bytes cut(bundle.begin(), bundle.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(split(cut).size(), size == 0 ? 0 : (size - 1) / 33) << size;
  }
}

TEST(Bundle, OfAnyBytesGivesPiecesInsideThem) {
  std::mt19937 random(7);
  for (int run = 0; run < 20000; ++run) {
    Bytes noise(random() % 300);
    for (std::uint8_t& byte : noise) byte = static_cast<std::uint8_t>(random() % 40);
    if (!noise.empty()) noise[0] = kBundleMark;
    std::size_t sum = 0;
    LinkFrames frames(noise);
    while (const auto frame = frames.next()) {
      ASSERT_GE(frame->data(), noise.data());
      ASSERT_LE(frame->data() + frame->size(), noise.data() + noise.size());
      ASSERT_LE(frame->size(), kMaxFrameBytes);
      sum += frame->size() + 1;
    }
    EXPECT_LE(sum + 1, std::max<std::size_t>(noise.size(), 1));
    (void)paddedBytes(noise);
  }
}

TEST(Field, TakesNoMoreBitsThanItsCodesNeed) {
  EXPECT_EQ((Field{0, 255, 1}.bits()), 8U);
  EXPECT_EQ((Field{0, 256, 1}.bits()), 9U);
  EXPECT_EQ((Field{0, 255, 1, true}.bits()), 9U);  // one more code for absent
  EXPECT_EQ((Field{5, 5, 1}.bits()), 0U);
}

TEST(Field, RoundTripsWithinHalfAStepIncludingBothBounds) {
  const Field field{-50, 6500, 0.05};
  std::mt19937 random(3);
  std::uniform_real_distribution<double> values(field.min, field.max);
  for (int i = 0; i < 2000; ++i) {
    const double value = i == 0 ? field.min : i == 1 ? field.max : values(random);
    EXPECT_NEAR(field.decode(field.encode(value)), value, field.resolution / 2 + 1e-9);
  }
}

TEST(Field, SaturatesOutsideItsBoundsAndKeepsAbsentApart) {
  const Field plain{0, 10, 0.5}, optional{0, 10, 0.5, true};
  EXPECT_EQ(plain.decode(plain.encode(1e300)), 10);
  EXPECT_EQ(plain.decode(plain.encode(-INFINITY)), 0);
  EXPECT_EQ(plain.decode(plain.encode(NAN)), 0);
  EXPECT_TRUE(std::isnan(optional.decode(optional.encode(NAN))));
  EXPECT_FALSE(plain.valid(NAN));
  EXPECT_TRUE(optional.valid(NAN));
  EXPECT_FALSE(optional.valid(10.1));
}

TEST(BitPacking, ReadsBackEveryWidthUnaligned) {
  std::mt19937_64 random(5);
  std::array<std::uint8_t, 1024> buffer{};
  buffer.fill(0xFF);  // old content must not shine through
  std::vector<std::pair<std::uint64_t, unsigned>> written;
  BitWriter w(buffer);
  for (unsigned bits = 1; bits <= 64; ++bits) {
    const std::uint64_t value = random() >> (64 - bits);
    w.put(value, bits);
    written.emplace_back(value, bits);
  }
  ASSERT_TRUE(w.ok());
  BitReader r{std::span(buffer).first(w.bytes())};
  for (const auto& [value, bits] : written) EXPECT_EQ(r.get(bits), value);
  EXPECT_TRUE(r.finished());
}

TEST(BitPacking, SignedValuesSurviveAtTheirBounds) {
  std::array<std::uint8_t, 8> buffer{};
  BitWriter w(buffer);
  w.putSigned(-4, 3);
  w.putSigned(3, 3);
  w.putSigned(-1, 17);
  BitReader r(buffer);
  EXPECT_EQ(r.getSigned(3), -4);
  EXPECT_EQ(r.getSigned(3), 3);
  EXPECT_EQ(r.getSigned(17), -1);
}

TEST(BitPacking, StopsAtTheEndOfTheBuffer) {
  std::array<std::uint8_t, 2> buffer{};
  BitWriter w(buffer);
  w.put(1, 15);
  w.put(3, 2);
  EXPECT_FALSE(w.ok());
  BitReader r(buffer);
  (void)r.get(17);
  EXPECT_FALSE(r.ok());
}

}  // namespace
}  // namespace fathom::telemetry

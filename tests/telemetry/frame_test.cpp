#include "telemetry/wire/frame.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "realtime/kernel/crc32.hpp"

namespace fathom::telemetry {
namespace {

constexpr LinkIdentity kOurs{7, 1234};

std::vector<std::uint8_t> makeFrame(std::uint16_t sequence, std::size_t payload = 20,
                                    LinkIdentity identity = kOurs) {
  std::vector<std::uint8_t> body(payload), out(kMaxFrameBytes);
  for (std::size_t i = 0; i < payload; ++i) body[i] = static_cast<std::uint8_t>(sequence + i);
  out.resize(encodeFrame({identity, sequence, MessageType::kTrack}, body, out));
  return out;
}

TEST(Frame, RoundTripsAtEverySize) {
  for (std::size_t payload = 0; payload <= kMaxFrameBytes - kFrameOverhead; ++payload) {
    const auto bytes = makeFrame(static_cast<std::uint16_t>(60000 + payload), payload);
    ASSERT_EQ(bytes.size(), payload + kFrameOverhead);
    const DecodedFrame frame = decodeFrame(bytes);
    ASSERT_EQ(frame.verdict, FrameVerdict::kAccepted);
    EXPECT_EQ(frame.header.identity, kOurs);
    EXPECT_EQ(frame.header.sequence, 60000 + payload);
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
  const auto bytes = makeFrame(9, 40);
  for (std::size_t n = 0; n < bytes.size(); ++n) {
    const FrameVerdict verdict = decodeFrame(std::span(bytes).first(n)).verdict;
    EXPECT_EQ(verdict, n < kFrameOverhead ? FrameVerdict::kTooShort : FrameVerdict::kBadCrc) << n;
  }
  EXPECT_EQ(decodeFrame(std::vector<std::uint8_t>(kMaxFrameBytes + 1)).verdict, FrameVerdict::kTooLong);
}

TEST(Frame, AnySingleFlippedBitIsRejected) {
  const auto good = makeFrame(77, 40);
  for (std::size_t bit = 0; bit < good.size() * 8; ++bit) {
    auto bytes = good;
    bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] ^ 1U << bit % 8);
    EXPECT_EQ(decodeFrame(bytes).verdict, FrameVerdict::kBadCrc) << bit;
  }
}

TEST(Frame, AnotherVersionAndAnUnknownTypeAreToldFromDamage) {
  std::vector<std::uint8_t> out(kMaxFrameBytes);
  const std::vector<std::uint8_t> body(5);
  const std::size_t size = encodeFrame({kOurs, 1, static_cast<MessageType>(0)}, body, out);
  const auto bytes = std::span(out).first(size);
  EXPECT_EQ(decodeFrame(bytes).verdict, FrameVerdict::kType);
  bytes[0] = static_cast<std::uint8_t>(bytes[0] ^ 0x20);  // version 1 instead of 3
  const std::uint32_t crc = crc32(bytes.first(size - 4));
  for (std::size_t i = 0; i < 4; ++i) bytes[size - 4 + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
  EXPECT_EQ(decodeFrame(bytes).verdict, FrameVerdict::kVersion);
}

}  // namespace
}  // namespace fathom::telemetry

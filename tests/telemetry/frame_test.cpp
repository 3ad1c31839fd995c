#include "telemetry/frame.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <vector>

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
  // The type nibble carries whatever the sender puts; 16 | type writes the next version into the nibble
  // above.
  auto size = encodeFrame({kOurs, 1, static_cast<MessageType>(15)}, body, out);
  EXPECT_EQ(decodeFrame(std::span(out).first(size)).verdict, FrameVerdict::kType);
  size = encodeFrame({kOurs, 1, static_cast<MessageType>(0x21)}, body, out);
  EXPECT_EQ(decodeFrame(std::span(out).first(size)).verdict, FrameVerdict::kVersion);
}

TEST(FrameReceiver, LocksTheFirstValidFramesDiveAndCountsTheOthersForeign) {
  FrameReceiver receiver;
  receiver.accept(std::vector<std::uint8_t>(30, 0xAA));
  EXPECT_FALSE(receiver.identity().has_value());
  EXPECT_EQ(receiver.accept(makeFrame(1)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(receiver.accept(makeFrame(2, 20, {7, 1235})).verdict, FrameVerdict::kForeign);
  EXPECT_EQ(receiver.accept(makeFrame(2, 20, {8, 1234})).verdict, FrameVerdict::kForeign);
  EXPECT_EQ(receiver.accept(makeFrame(2)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kForeign], 2U);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kBadCrc], 1U);
}

TEST(FrameReceiver, ForeignFramesDoNotMoveTheSequence) {
  FrameReceiver receiver(kOurs);
  receiver.accept(makeFrame(1));
  receiver.accept(makeFrame(1000, 20, {1, 1}));
  receiver.accept(makeFrame(2));
  EXPECT_EQ(receiver.counters().lost, 0U);
}

TEST(FrameReceiver, CountsLostReorderedAndDuplicateOverTheWrapOfTheSequence) {
  FrameReceiver receiver(kOurs);
  std::mt19937 random(11);
  std::uint64_t lost = 0, duplicates = 0;
  std::uint16_t sequence = 65000;
  receiver.accept(makeFrame(sequence++));
  for (int i = 0; i < 3000; ++i) {
    switch (random() % 6) {
      case 0:
        ++lost;
        ++sequence;
        break;
      case 1: {  // a pair the wrong way round
        EXPECT_EQ(receiver.accept(makeFrame(static_cast<std::uint16_t>(sequence + 1))).verdict,
                  FrameVerdict::kAccepted);
        EXPECT_EQ(receiver.accept(makeFrame(sequence)).verdict, FrameVerdict::kAccepted);
        sequence = static_cast<std::uint16_t>(sequence + 2);
        break;
      }
      case 2:
        receiver.accept(makeFrame(sequence));
        EXPECT_EQ(receiver.accept(makeFrame(sequence++)).verdict, FrameVerdict::kDuplicate);
        ++duplicates;
        break;
      default:
        EXPECT_EQ(receiver.accept(makeFrame(sequence++)).verdict, FrameVerdict::kAccepted);
    }
  }
  receiver.accept(makeFrame(sequence));  // closes the last gap
  EXPECT_EQ(receiver.counters().lost, lost);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kDuplicate], duplicates);
  EXPECT_EQ(receiver.counters().resyncs, 0U);
}

TEST(FrameReceiver, ASenderThatBeginsAnewIsFollowedAndNotCountedAsLoss) {
  FrameReceiver receiver(kOurs);
  receiver.accept(makeFrame(20000));
  EXPECT_EQ(receiver.accept(makeFrame(0)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(receiver.accept(makeFrame(1)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(receiver.counters().resyncs, 1U);
  EXPECT_EQ(receiver.counters().lost, 0U);
}

TEST(FrameReceiver, EveryFrameGivenIsInExactlyOneCounter) {
  FrameReceiver receiver(kOurs);
  std::mt19937 random(2);
  for (int i = 0; i < 5000; ++i) {
    auto bytes = makeFrame(static_cast<std::uint16_t>(random() % 500), random() % 200,
                           random() % 4 == 0 ? LinkIdentity{1, 1} : kOurs);
    if (random() % 3 == 0) bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1 + random() % 255);
    if (random() % 5 == 0) bytes.resize(random() % (bytes.size() + 1));
    const DecodedFrame frame = receiver.accept(bytes);
    if (frame.verdict == FrameVerdict::kAccepted && random() % 4 == 0) receiver.rejectPayload();
  }
  std::uint64_t sum = 0;
  for (const std::uint64_t n : receiver.counters().verdicts) sum += n;
  EXPECT_EQ(sum, receiver.counters().frames);
  EXPECT_EQ(sum, 5000U);
}

}  // namespace
}  // namespace fathom::telemetry

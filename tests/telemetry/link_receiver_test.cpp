#include "telemetry/ship/link_receiver.hpp"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace fathom::telemetry {
namespace {

constexpr LinkIdentity kOurs{7, 1234};

std::vector<std::uint8_t> makeFrame(std::uint16_t sequence, std::size_t payload = 20,
                                    LinkIdentity identity = kOurs, MessageType type = MessageType::kTrack) {
  std::vector<std::uint8_t> body(payload), out(kMaxFrameBytes);
  for (std::size_t i = 0; i < payload; ++i) body[i] = static_cast<std::uint8_t>(sequence + i);
  out.resize(encodeFrame({identity, sequence, type}, body, out));
  return out;
}

DecodedFrame take(LinkReceiver& receiver, std::span<const std::uint8_t> bytes) {
  return receiver.accept(bytes, [](MessageType, std::span<const std::uint8_t>) { return true; });
}

TEST(LinkReceiver, LocksTheFirstValidFramesDiveAndCountsTheOthersForeign) {
  LinkReceiver receiver;
  take(receiver, std::vector<std::uint8_t>(30, 0xAA));
  EXPECT_FALSE(receiver.identity().has_value());
  EXPECT_EQ(take(receiver, makeFrame(1)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(take(receiver, makeFrame(2, 20, {7, 1235})).verdict, FrameVerdict::kForeign);
  EXPECT_EQ(take(receiver, makeFrame(2, 20, {8, 1234})).verdict, FrameVerdict::kForeign);
  EXPECT_EQ(take(receiver, makeFrame(2)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kForeign], 2U);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kBadCrc], 1U);
}

TEST(LinkReceiver, ForeignFramesDoNotMoveTheSequence) {
  LinkReceiver receiver(kOurs);
  take(receiver, makeFrame(1));
  take(receiver, makeFrame(1000, 20, {1, 1}));
  take(receiver, makeFrame(2));
  EXPECT_EQ(receiver.counters().lost, 0U);
}

TEST(LinkReceiver, CountsLostReorderedAndDuplicateOverTheWrapOfTheSequence) {
  LinkReceiver receiver(kOurs);
  std::mt19937 random(11);
  std::uint64_t lost = 0, duplicates = 0;
  std::uint16_t sequence = 65000;
  take(receiver, makeFrame(sequence++));
  for (int i = 0; i < 3000; ++i) {
    switch (random() % 6) {
      case 0:
        ++lost;
        ++sequence;
        break;
      case 1: {  // a pair the wrong way round
        EXPECT_EQ(take(receiver, makeFrame(static_cast<std::uint16_t>(sequence + 1))).verdict,
                  FrameVerdict::kAccepted);
        EXPECT_EQ(take(receiver, makeFrame(sequence)).verdict, FrameVerdict::kAccepted);
        sequence = static_cast<std::uint16_t>(sequence + 2);
        break;
      }
      case 2:
        take(receiver, makeFrame(sequence));
        EXPECT_EQ(take(receiver, makeFrame(sequence++)).verdict, FrameVerdict::kDuplicate);
        ++duplicates;
        break;
      default:
        EXPECT_EQ(take(receiver, makeFrame(sequence++)).verdict, FrameVerdict::kAccepted);
    }
  }
  take(receiver, makeFrame(sequence));  // closes the last gap
  EXPECT_EQ(receiver.counters().lost, lost);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kDuplicate], duplicates);
  EXPECT_EQ(receiver.counters().resyncs, 0U);
}

TEST(LinkReceiver, ASenderThatBeginsAnewIsFollowedAndNotCountedAsLoss) {
  LinkReceiver receiver(kOurs);
  take(receiver, makeFrame(20000));
  EXPECT_EQ(take(receiver, makeFrame(0)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(take(receiver, makeFrame(1)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(receiver.counters().resyncs, 1U);
  EXPECT_EQ(receiver.counters().lost, 0U);
}

TEST(LinkReceiver, EveryFrameGivenIsInExactlyOneCounter) {
  LinkReceiver receiver(kOurs);
  std::mt19937 random(2);
  for (int i = 0; i < 5000; ++i) {
    auto bytes = makeFrame(static_cast<std::uint16_t>(random() % 500), random() % 200,
                           random() % 4 == 0 ? LinkIdentity{1, 1} : kOurs);
    if (random() % 3 == 0) bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1 + random() % 255);
    if (random() % 5 == 0) bytes.resize(random() % (bytes.size() + 1));
    (void)receiver.accept(bytes,
                          [&](MessageType, std::span<const std::uint8_t>) { return random() % 4 != 0; });
  }
  std::uint64_t sum = 0;
  for (const std::uint64_t n : receiver.counters().verdicts) sum += n;
  EXPECT_EQ(sum, receiver.counters().frames);
  EXPECT_EQ(sum, 5000U);
  EXPECT_GT(receiver.counters()[FrameVerdict::kBadPayload], 100U);
}

}  // namespace
}  // namespace fathom::telemetry

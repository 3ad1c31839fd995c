#include <gtest/gtest.h>

#include <random>

#include "telemetry/ship/link_receiver.hpp"
#include "telemetry/wire/packet_log.hpp"
#include "tests/support/test_data.hpp"
#include "tests/telemetry/sample_frames.hpp"

namespace fathom::telemetry {
namespace {

DecodedFrame take(LinkReceiver& receiver, std::span<const std::uint8_t> bytes) {
  return receiver.accept(bytes, [](const auto&) { return true; });
}

TEST(LinkReceiver, LocksTheFirstValidFramesDiveAndCountsTheOthersForeign) {
  LinkReceiver receiver;
  take(receiver, std::vector<std::uint8_t>(30, 0xAA));
  EXPECT_FALSE(receiver.identity().has_value());
  EXPECT_EQ(take(receiver, countingFrame(1)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(take(receiver, countingFrame(2, 20, {7, 1235})).verdict, FrameVerdict::kForeign);
  EXPECT_EQ(take(receiver, countingFrame(2, 20, {8, 1234})).verdict, FrameVerdict::kForeign);
  EXPECT_EQ(take(receiver, countingFrame(2)).verdict, FrameVerdict::kAccepted);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kForeign], 2U);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kBadTag], 1U);
}

TEST(LinkReceiver, ForeignFramesDoNotMoveTheSequence) {
  LinkReceiver receiver(kOurs);
  take(receiver, countingFrame(1));
  take(receiver, countingFrame(1000, 20, {1, 1}));
  take(receiver, countingFrame(2));
  EXPECT_EQ(receiver.counters().lost, 0U);
}

TEST(LinkReceiver, CountsLostReorderedAndDuplicateOverTheWrapOfTheSequence) {
  LinkReceiver receiver(kOurs);
  std::mt19937 random(11);
  std::uint64_t lost = 0, duplicates = 0;
  std::uint16_t sequence = 65000;
  take(receiver, countingFrame(sequence++));
  for (int i = 0; i < 3000; ++i) {
    switch (random() % 6) {
      case 0:
        ++lost;
        ++sequence;
        break;
      case 1: {  // a pair in the wrong order
        EXPECT_EQ(take(receiver, countingFrame(static_cast<std::uint16_t>(sequence + 1))).verdict,
                  FrameVerdict::kAccepted);
        EXPECT_EQ(take(receiver, countingFrame(sequence)).verdict, FrameVerdict::kAccepted);
        sequence = static_cast<std::uint16_t>(sequence + 2);
        break;
      }
      case 2:
        take(receiver, countingFrame(sequence));
        EXPECT_EQ(take(receiver, countingFrame(sequence++)).verdict, FrameVerdict::kDuplicate);
        ++duplicates;
        break;
      default:
        EXPECT_EQ(take(receiver, countingFrame(sequence++)).verdict, FrameVerdict::kAccepted);
    }
  }
  take(receiver, countingFrame(sequence));  // closes the last gap
  EXPECT_EQ(receiver.counters().lost, lost);
  EXPECT_EQ(receiver.counters()[FrameVerdict::kDuplicate], duplicates);
  EXPECT_EQ(receiver.counters().resyncs, 0U);
}

TEST(LinkReceiver, ASenderThatRestartsIsFollowedAndNotCountedAsLoss) {
  LinkReceiver receiver(kOurs);
  Version before = 0, after = 0;
  receiver.accept(countingFrame(20000),
                  [&](const LinkReceiver::Message& m) { return (before = m.version) > 0; });
  // A frame of long ago, or some in any order, are no beginning.
  for (const int sequence : {7, 3, 9, 2})
    EXPECT_EQ(take(receiver, countingFrame(static_cast<std::uint16_t>(sequence))).verdict,
              FrameVerdict::kDuplicate);
  EXPECT_EQ(take(receiver, countingFrame(20001)).verdict, FrameVerdict::kAccepted);
  for (const int sequence : {0, 1, 2}) take(receiver, countingFrame(static_cast<std::uint16_t>(sequence)));
  receiver.accept(countingFrame(3), [&](const LinkReceiver::Message& m) { return (after = m.version) > 0; });
  EXPECT_EQ(receiver.counters().resyncs, 1U);
  EXPECT_EQ(receiver.counters().lost, 0U);
  EXPECT_GT(after, before + 1);
}

TEST(LinkReceiver, AnOutageIsLossHoweverLongAndNoBeginning) {
  LinkReceiver receiver(kOurs);
  take(receiver, countingFrame(0));
  take(receiver, countingFrame(30000));
  EXPECT_EQ(receiver.counters().lost, 29999U);
  EXPECT_EQ(receiver.counters().resyncs, 0U);
  const Acknowledgement a = receiver.acknowledgement();
  EXPECT_EQ(a.received(30000), true);
  EXPECT_EQ(a.received(2), false);
}

TEST(LinkReceiver, EveryMessageHasItsPlaceInTheDiveInWhateverOrderTheyCome) {
  LinkReceiver receiver(kOurs);
  std::vector<Version> versions;
  for (const int sequence : {65500, 65530, 4, 65501, 10, 2})
    receiver.accept(countingFrame(static_cast<std::uint16_t>(sequence)), [&](const LinkReceiver::Message& m) {
      versions.push_back(m.version);
      return true;
    });
  ASSERT_EQ(versions.size(), 6U);
  for (std::size_t k = 0; k < versions.size(); ++k)
    EXPECT_EQ(static_cast<int>(versions[k] - versions[0]), (std::array{0, 30, 40, 1, 46, 38}[k]));
}

TEST(LinkReceiver, ReportsInTurnWhatItLacksFurtherBackThanTheLatestFrames) {
  LinkReceiver receiver(kOurs);
  for (int k = 0; k < 2000; ++k) {
    if (k == 900) receiver.noteDamage();  // the file has lost what came from 850 on
    if (k >= 100 && (k < 850 || k >= 900) && (k < 400 || k >= 630))
      take(receiver, countingFrame(static_cast<std::uint16_t>(k)));
  }
  std::vector<int> said(2000, 0);  // times that it was said to be held (+) or not (-)
  for (int k = 0; k < 100; ++k) {
    const auto a = receiver.furtherAcknowledgement(true);
    ASSERT_TRUE(a);
    for (int n = 0; n <= a->newest; ++n) {
      const auto received = a->receivedBack(static_cast<std::uint32_t>(a->newest - n));
      if (!received) continue;
      const bool held = n >= 100 && (n < 850 || n >= 900) && (n < 400 || n >= 630);
      ASSERT_EQ(*received, held) << n;
      ++said[static_cast<std::size_t>(n)];
    }
  }
  for (std::size_t n = 0; n < 1900; ++n) EXPECT_GT(said[n], 0) << n;
  EXPECT_GE(said[50], 4);   // before it came
  EXPECT_GE(said[860], 4);  // damage
  EXPECT_GE(said[410], 4);  // an outage
}

TEST(LinkReceiver, EveryFrameGivenIsInExactlyOneCounter) {
  LinkReceiver receiver(kOurs);
  std::mt19937 random(2);
  for (int i = 0; i < 5000; ++i) {
    auto bytes = countingFrame(static_cast<std::uint16_t>(random() % 500), random() % 200,
                               random() % 4 == 0 ? LinkIdentity{1, 1} : kOurs);
    if (random() % 3 == 0) bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1 + random() % 255);
    if (random() % 5 == 0) bytes.resize(random() % (bytes.size() + 1));
    (void)receiver.accept(bytes, [&](const auto&) { return random() % 4 != 0; });
  }
  std::uint64_t sum = 0;
  for (const std::uint64_t n : receiver.counters().verdicts) sum += n;
  EXPECT_EQ(sum, receiver.counters().frames);
  EXPECT_EQ(sum, 5000U);
  EXPECT_GT(receiver.counters()[FrameVerdict::kBadPayload], 100U);
}

TEST(PacketLog, RoundTripsFramesAndTimes) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "packets.bin";
  {
    std::ofstream stream(path, std::ios::binary);
    for (int n = 1; n <= 256; n += 51)
      ASSERT_TRUE(writePacket(stream, -5 + n, std::vector<std::uint8_t>(static_cast<std::size_t>(n), 0xAB)));
  }
  PacketLogReader reader(path);
  for (int n = 1; n <= 256; n += 51) {
    const auto packet = reader.next();
    ASSERT_TRUE(packet);
    EXPECT_EQ(packet->utc_ns, -5 + n);
    EXPECT_EQ(packet->bytes, std::vector<std::uint8_t>(static_cast<std::size_t>(n), 0xAB));
  }
  EXPECT_FALSE(reader.next());
}

TEST(PacketLog, TruncatedAtAnyByteGivesTheWholePacketsThenOneClearError) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "packets.bin";
  std::ostringstream stream;
  for (int n = 0; n < 3; ++n) ASSERT_TRUE(writePacket(stream, n, std::vector<std::uint8_t>(20, 1)));
  const std::string whole = stream.str();
  for (std::size_t n = 0; n <= whole.size(); ++n) {
    test::writeText(path, whole.substr(0, n));
    PacketLogReader reader(path);
    std::size_t packets = 0;
    try {
      while (reader.next()) ++packets;
      EXPECT_EQ(n % 32, 0U);
    } catch (const InputError& error) {
      EXPECT_NE(n % 32, 0U);
      EXPECT_NE(std::string(error.what()).find("byte " + std::to_string(n / 32 * 32)), std::string::npos);
    }
    EXPECT_EQ(packets, n / 32);
  }
}

TEST(PacketLog, RefusesLengthsThatNoFrameHas) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "packets.bin";
  for (const char* head : {"\0\0\0\0", "\1\10\0\0", "\377\377\377\377"}) {
    test::writeText(path, std::string(head, 4) + std::string(2100, 'x'));
    PacketLogReader reader(path);
    EXPECT_THROW((void)reader.next(), InputError);
  }
  EXPECT_THROW(PacketLogReader(folder.path() / "absent.bin"), InputError);
  EXPECT_THROW(PacketLogReader(folder.path()), InputError);
}

}  // namespace
}  // namespace fathom::telemetry

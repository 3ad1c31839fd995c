#include "telemetry/downlink/downlink.hpp"

#include <gtest/gtest.h>

#include <random>

#include "tests/telemetry/sample_frames.hpp"

namespace fathom::telemetry {
namespace {

Bytes frameOf(DownlinkSender& sender, std::int64_t utc_ns) {
  std::array<std::uint8_t, kMaxFrameBytes> buffer{};
  const std::size_t size = sender.nextFrame(utc_ns, buffer);
  return {buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(size)};
}

Acknowledgement acknowledgementOf(std::uint16_t newest) {
  Acknowledgement a{.valid = true, .newest = newest, .reach = Acknowledgement::kMaxReach, .before = {}};
  a.before.set();
  return a;
}

Request requestOf(Request::Kind kind) {
  Request r{.kind = kind, .rate_bps = 300};
  r.north_max = r.east_max = 4;
  return r;
}

UsblFixMessage fixAt(std::int64_t utc_ns) {
  return {utc_ns, -33.5, 151.25, 40, 2};
}

class Downlink : public testing::Test {
 protected:
  DownlinkSender ship{kOurs, keyOf(1)};
  DownlinkReceiver vehicle{kOurs, keyOf(1), kStart_ns};
  // Requests that wait to be said.
  [[nodiscard]] std::size_t waiting() const {
    std::size_t count = 0;
    for (std::size_t id = 0; id < DownlinkSender::kMaxRequests; ++id)
      count += ship.waits(static_cast<std::uint8_t>(id)) ? 1 : 0;
    return count;
  }
};

TEST_F(Downlink, WhatTheShipSaysArrivesInTheSmallestFrames) {
  ship.acknowledge(acknowledgementOf(500));
  ASSERT_TRUE(ship.addFix(fixAt(kStart_ns + 8 * kSecond_ns)));
  ASSERT_TRUE(ship.request(requestOf(Request::Kind::kDetail)));
  bool acknowledged = false, fixed = false, requested = false;
  for (int i = 1; i <= 6; ++i) {
    const Bytes frame = frameOf(ship, kStart_ns + (10 + i) * kSecond_ns);
    ASSERT_FALSE(frame.empty());
    EXPECT_LE(frame.size(), kMinFrameBytes);
    const auto result = vehicle.accept(kStart_ns + (11 + i) * kSecond_ns, frame);
    EXPECT_EQ(result.verdict, DownlinkVerdict::kAccepted);
    if (result.content.acknowledgement) acknowledged = result.content.acknowledgement->newest == 500;
    if (result.content.fix) fixed = result.content.fix->utc_ns == kStart_ns + 8 * kSecond_ns;
    if (result.content.request) {
      EXPECT_FALSE(requested) << "a repetition is done once";
      requested = true;
    }
  }
  EXPECT_TRUE(acknowledged && fixed && requested);
  EXPECT_EQ(vehicle.counters().fixes, 1U);
  EXPECT_EQ(vehicle.counters().requests, 1U);
  EXPECT_GE(vehicle.counters().repeated_requests, 1U);
}

TEST_F(Downlink, AnAcknowledgementIsSaidAtLeastEverySecondTurn) {
  int since = 0;
  for (int i = 0; i < 40; ++i) {
    ship.acknowledge(acknowledgementOf(static_cast<std::uint16_t>(i)));
    (void)ship.addFix(fixAt(kStart_ns + i * kSecond_ns));
    (void)ship.request(requestOf(Request::Kind::kDetail));
    (void)frameOf(ship, kStart_ns + i * kSecond_ns);
    since = ship.counters().acknowledgements * 2 >= ship.counters().frames - 1 ? 0 : since + 1;
    EXPECT_EQ(since, 0) << i;
  }
  EXPECT_GT(ship.counters().fixes + ship.counters().requests, 15U);
}

TEST_F(Downlink, ALargeFrameSaysAllAtOnce) {
  DownlinkSender sender(kOurs, keyOf(1), 96);
  sender.acknowledge(acknowledgementOf(500));
  (void)sender.addFix(fixAt(kStart_ns));
  (void)sender.request(requestOf(Request::Kind::kDetail));
  const auto result = vehicle.accept(kStart_ns, frameOf(sender, kStart_ns + kSecond_ns));
  EXPECT_TRUE(result.content.fix && result.content.request && result.content.acknowledgement);
  EXPECT_EQ(result.content.acknowledgement->reach, Acknowledgement::kMaxReach);
}

TEST_F(Downlink, WithNothingToSayThereIsNoFrame) {
  EXPECT_TRUE(frameOf(ship, kStart_ns).empty());
  ship.acknowledge({});
  EXPECT_TRUE(frameOf(ship, kStart_ns).empty());
}

TEST_F(Downlink, AReplayedFrameIsRefusedHoweverLateItComes) {
  ship.acknowledge(acknowledgementOf(1));
  std::vector<Bytes> recorded;
  for (int i = 1; i <= 5; ++i) {
    recorded.push_back(frameOf(ship, kStart_ns + i * kSecond_ns));
    EXPECT_EQ(vehicle.accept(kStart_ns, recorded.back()).verdict, DownlinkVerdict::kAccepted);
  }
  for (const Bytes& frame : recorded)
    EXPECT_EQ(vehicle.accept(kStart_ns + 3600 * kSecond_ns, frame).verdict, DownlinkVerdict::kOld);
  EXPECT_EQ(vehicle.counters()[DownlinkVerdict::kOld], 5U);
}

TEST_F(Downlink, RecordingsFromBeforeTheDiveAreRefusedByAVehicleThatJustStarted) {
  ship.acknowledge(acknowledgementOf(1));
  const Bytes early = frameOf(ship, kStart_ns - kSecond_ns);
  EXPECT_EQ(vehicle.accept(kStart_ns, early).verdict, DownlinkVerdict::kOld);
}

TEST_F(Downlink, ARestartedShipIsAcceptedAtOnce) {
  for (int run = 0; run < 3; ++run) {
    DownlinkSender sender(kOurs, keyOf(1));
    sender.acknowledge(acknowledgementOf(1));
    EXPECT_EQ(vehicle.accept(kStart_ns, frameOf(sender, kStart_ns + (1 + run) * kSecond_ns)).verdict,
              DownlinkVerdict::kAccepted);
  }
}

TEST_F(Downlink, TheCounterRisesEvenWhenTheShipsClockDoesNot) {
  ship.acknowledge(acknowledgementOf(1));
  for (int i = 0; i < 10; ++i)
    EXPECT_EQ(vehicle.accept(kStart_ns, frameOf(ship, kStart_ns + kSecond_ns - i * 1000)).verdict,
              DownlinkVerdict::kAccepted);
}

TEST_F(Downlink, ACounterAtItsEndStaysThereAndIsRefused) {
  ship.acknowledge(acknowledgementOf(1));
  constexpr std::int64_t kFarAway_ns = 4'000'000'000 * kSecond_ns;
  const auto sent_lately = [](const Acknowledgement& a) { return std::optional<Version>(a.newest); };
  EXPECT_EQ(vehicle.accept(kStart_ns, frameOf(ship, kFarAway_ns)).verdict, DownlinkVerdict::kStale);
  EXPECT_EQ(vehicle.accept(kStart_ns, frameOf(ship, kFarAway_ns), sent_lately).verdict,
            DownlinkVerdict::kAccepted);
  const Bytes frame = frameOf(ship, kFarAway_ns);
  EXPECT_EQ(vehicle.accept(kStart_ns, frame, sent_lately).verdict, DownlinkVerdict::kOld);
}

TEST_F(Downlink, FramesOfAnotherKeyVehicleOrDiveChangeNothing) {
  const auto say = [&](const LinkIdentity& identity, const std::optional<LinkKey>& key) {
    DownlinkSender sender(identity, key);
    (void)sender.request(requestOf(Request::Kind::kPauseMap));
    return vehicle.accept(kStart_ns, frameOf(sender, kStart_ns + kSecond_ns));
  };
  EXPECT_EQ(say(kOurs, keyOf(2)).verdict, DownlinkVerdict::kBadSignature);
  EXPECT_EQ(say(kOurs, std::nullopt).verdict, DownlinkVerdict::kUnsigned);
  EXPECT_EQ(say({8, 1234}, keyOf(1)).verdict, DownlinkVerdict::kForeign);
  EXPECT_EQ(say({7, 1235}, keyOf(1)).verdict, DownlinkVerdict::kForeign);
  EXPECT_EQ(vehicle.counters().refused(), 4U);
  EXPECT_EQ(vehicle.counters().requests, 0U);
  // None of them has moved the counter.
  const auto good = say(kOurs, keyOf(1));
  EXPECT_EQ(good.verdict, DownlinkVerdict::kAccepted);
  EXPECT_TRUE(good.content.request);
}

TEST_F(Downlink, AFrameSignedForAnotherDiveDoesNotPassUnderThisOnesName) {
  DownlinkSender sender({7, 1235}, keyOf(1));
  (void)sender.request(requestOf(Request::Kind::kPauseMap));
  const Bytes frame = frameOf(sender, kStart_ns + kSecond_ns);
  FrameHeader header{.identity = kOurs, .type = MessageType::kDownlink};
  EXPECT_EQ(vehicle.accept(kStart_ns, frameWith(header, decodeFrame(frame).payload)).verdict,
            DownlinkVerdict::kBadSignature);
}

TEST_F(Downlink, AChangedBitAnywhereIsNotAccepted) {
  (void)ship.request(requestOf(Request::Kind::kDetail));
  const Bytes good = frameOf(ship, kStart_ns + kSecond_ns);
  const auto payload = decodeFrame(good).payload;
  FrameHeader header = decodeFrame(good).header;
  for (std::size_t bit = 0; bit < 8 * payload.size(); ++bit) {
    Bytes changed(payload.begin(), payload.end());
    changed[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    DownlinkReceiver receiver(kOurs, keyOf(1), kStart_ns);
    // The forger makes the tag good.
    EXPECT_NE(receiver.accept(kStart_ns, frameWith(header, changed)).verdict, DownlinkVerdict::kAccepted)
        << bit;
  }
}

TEST_F(Downlink, AFloodOfForgeriesHidesNoTrueFrame) {
  DownlinkSender forger(kOurs, keyOf(9));
  forger.acknowledge(acknowledgementOf(1));
  for (int k = 1; k <= 100; ++k) {
    const std::int64_t now_ns = kStart_ns + k * kSecond_ns;
    for (int i = 0; i < 20; ++i)
      EXPECT_EQ(vehicle.accept(now_ns, frameOf(forger, now_ns + kSecond_ns)).verdict,
                DownlinkVerdict::kBadSignature);
    ship.acknowledge(acknowledgementOf(static_cast<std::uint16_t>(k)));
    EXPECT_EQ(vehicle.accept(now_ns, frameOf(ship, now_ns)).verdict, DownlinkVerdict::kAccepted);
  }
}

TEST_F(Downlink, WhatWasHeldBackForHoursIsNotObeyed) {
  (void)ship.request(requestOf(Request::Kind::kPauseMap));
  ship.acknowledge(acknowledgementOf(1));
  const Bytes frame = frameOf(ship, kStart_ns + kSecond_ns);
  const auto sent_lately = [](const Acknowledgement&) { return std::nullopt; };
  const auto result = vehicle.accept(kStart_ns + 7200 * kSecond_ns, frame, sent_lately);
  EXPECT_EQ(result.verdict, DownlinkVerdict::kStale);
  EXPECT_TRUE(result.content.empty());
}

TEST_F(Downlink, AShipWithAClockYearsOffOrSetBackIsAcceptedByItsAcknowledgements) {
  constexpr std::int64_t kYear_ns = 365LL * 86400 * kSecond_ns;
  DownlinkReceiver receiver(kOurs, keyOf(1), kStart_ns);
  const auto sent_lately = [](const Acknowledgement& a) { return std::optional<Version>(a.newest); };
  std::uint16_t newest = 0;
  for (const std::int64_t off_ns : {2 * kYear_ns, std::int64_t{0}, -kYear_ns, 600 * kSecond_ns}) {
    DownlinkSender sender(kOurs, keyOf(1));
    sender.acknowledge(acknowledgementOf(++newest));
    const std::int64_t now_ns = kStart_ns + newest * 60 * kSecond_ns;
    const Bytes frame = frameOf(sender, now_ns + off_ns);
    EXPECT_EQ(receiver.accept(now_ns, frame, sent_lately).verdict, DownlinkVerdict::kAccepted) << off_ns;
    EXPECT_EQ(receiver.accept(now_ns, frame, sent_lately).verdict, DownlinkVerdict::kOld) << "again";
  }
}

TEST_F(Downlink, AShipThatWasStartedAgainIsObeyedThoughItCountsItsRequestsFromZero) {
  std::int64_t now_ns = kStart_ns;
  for (const auto kind : {Request::Kind::kPauseMap, Request::Kind::kResumeMap, Request::Kind::kPauseMap}) {
    DownlinkSender started_again(kOurs, keyOf(1));
    (void)started_again.request(requestOf(kind));  // id 0, every time
    now_ns += 20 * kSecond_ns;
    const auto result = vehicle.accept(now_ns, frameOf(started_again, now_ns));
    ASSERT_TRUE(result.content.request);
    EXPECT_EQ(result.content.request->kind, kind);
  }
}

TEST_F(Downlink, WithoutAKeyOnBoardAcknowledgementsAndFixesCountButNoRequests) {
  for (const bool is_signed : {false, true}) {
    DownlinkReceiver receiver(kOurs, std::nullopt, kStart_ns);
    DownlinkSender sender(kOurs, is_signed ? std::optional(keyOf(1)) : std::nullopt, 96);
    sender.acknowledge(acknowledgementOf(1));
    (void)sender.addFix(fixAt(kStart_ns));
    (void)sender.request(requestOf(Request::Kind::kPauseMap));
    const Bytes frame = frameOf(sender, kStart_ns + kSecond_ns);
    const auto result = receiver.accept(kStart_ns, frame);
    EXPECT_EQ(result.verdict, DownlinkVerdict::kNoKey);
    EXPECT_FALSE(result.content.request);
    EXPECT_TRUE(result.content.fix && result.content.acknowledgement);
    EXPECT_EQ(receiver.accept(kStart_ns, frame).verdict, DownlinkVerdict::kOld) << "its echo";
  }
}

TEST_F(Downlink, NoiseAndUplinkFramesAreCountedAndNothingElse) {
  std::mt19937 random(7);
  for (int i = 0; i < 2000; ++i) {
    Bytes noise(random() % 300);
    for (std::uint8_t& b : noise) b = static_cast<std::uint8_t>(random());
    EXPECT_EQ(vehicle.accept(kStart_ns, noise).verdict, DownlinkVerdict::kBadFrame);
  }
  FrameHeader header{.identity = kOurs, .type = MessageType::kStatus};
  EXPECT_EQ(vehicle.accept(kStart_ns, frameWith(header, Bytes(22, 1))).verdict, DownlinkVerdict::kBadFrame);
  // Downlink frames whose payload is noise, of every length.
  header.type = MessageType::kDownlink;
  for (std::size_t size = 0; size <= kMaxFrameBytes - kFrameOverhead; ++size) {
    Bytes noise(size);
    for (std::uint8_t& b : noise) b = static_cast<std::uint8_t>(random());
    EXPECT_NE(vehicle.accept(kStart_ns, frameWith(header, noise)).verdict, DownlinkVerdict::kAccepted);
  }
}

TEST_F(Downlink, ANewerRequestTakesThePlaceOfTheOneItMakesVoid) {
  ASSERT_TRUE(ship.request(requestOf(Request::Kind::kPauseMap)));
  ASSERT_TRUE(ship.request(requestOf(Request::Kind::kRate)));
  ASSERT_TRUE(ship.request(requestOf(Request::Kind::kResumeMap)));
  ASSERT_TRUE(ship.request(requestOf(Request::Kind::kRate)));
  EXPECT_EQ(waiting(), 2U);
  ASSERT_TRUE(ship.request(requestOf(Request::Kind::kDetail)));
  ASSERT_TRUE(ship.request(requestOf(Request::Kind::kDetail)));
  EXPECT_EQ(waiting(), 4U);
}

TEST_F(Downlink, RequestsAreBoundedConfirmedAndForgottenAfterTheirRepetitions) {
  for (std::size_t i = 0; i < DownlinkSender::kMaxRequests; ++i)
    ASSERT_TRUE(ship.request(requestOf(Request::Kind::kDetail)));
  EXPECT_FALSE(ship.request(requestOf(Request::Kind::kDetail)));
  Request wrong = requestOf(Request::Kind::kRate);
  wrong.rate_bps = 1e9;
  EXPECT_FALSE(ship.request(wrong));
  ship.confirm(0);
  EXPECT_EQ(waiting(), DownlinkSender::kMaxRequests) << "not said yet: an older one of this id";
  (void)frameOf(ship, kStart_ns);
  ship.confirm(0);
  EXPECT_EQ(waiting(), DownlinkSender::kMaxRequests - 1);
  int frames = 1;
  while (!frameOf(ship, kStart_ns).empty()) ++frames;
  EXPECT_EQ(frames, 1 + DownlinkSender::kRepetitions * static_cast<int>(DownlinkSender::kMaxRequests - 1));
}

TEST_F(Downlink, AStaleFixIsDroppedAndCountedAndHoldsNothingUp) {
  ship.acknowledge(acknowledgementOf(1));
  ASSERT_TRUE(ship.addFix(fixAt(kStart_ns - 1000 * kSecond_ns)));
  EXPECT_FALSE(frameOf(ship, kStart_ns).empty());
  EXPECT_EQ(ship.counters().stale_fixes, 1U);
  EXPECT_EQ(ship.counters().fixes, 0U);
  UsblFixMessage nowhere = fixAt(kStart_ns);
  nowhere.latitude = 91;
  EXPECT_FALSE(ship.addFix(nowhere));
}

}  // namespace
}  // namespace fathom::telemetry

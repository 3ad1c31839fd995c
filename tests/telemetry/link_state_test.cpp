// A link that was saved and loaded continues with the frames that would have been sent.
#include <gtest/gtest.h>

#include "telemetry/downlink/downlink.hpp"
#include "telemetry/ship/link_receiver.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"
#include "tests/support/saved_state.hpp"
#include "tests/telemetry/sample_frames.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::telemetry {
namespace {

LinkSchedulerConfig stateConfig(bool answered, double rate_bps) {
  LinkSchedulerConfig c;
  c.identity = kOurs;
  c.rate_bps = rate_bps;
  c.half_duplex = answered;
  c.blocks.max_squares = 24;
  return c;
}

bool load(LinkScheduler& scheduler, std::span<const std::uint8_t> bytes) {
  rt::StateReader reader(bytes);
  return scheduler.load(reader);
}

void restart(std::unique_ptr<LinkScheduler>& scheduler, const LinkSchedulerConfig& c) {
  const std::vector<std::uint8_t> state = test::savedState(*scheduler);
  scheduler = std::make_unique<LinkScheduler>(c);
  scheduler->setMissionInfo({"sirius", {}, kStart_ns, 0});
  ASSERT_TRUE(load(*scheduler, state));
  EXPECT_EQ(test::savedState(*scheduler), state);
}

// Ten minutes of a growing map over water that loses every sixth frame; the program starts again at the given
// seconds. All frames, one after the other.
std::vector<std::uint8_t> dive(const LinkSchedulerConfig& c, const std::vector<int>& restarts) {
  auto scheduler = std::make_unique<LinkScheduler>(c);
  scheduler->setMissionInfo({"sirius", {}, kStart_ns, 0});
  LinkReceiver ship(kOurs);
  std::vector<std::uint8_t> frames;
  std::array<std::uint8_t, kMaxFrameBytes> frame;
  int sent = 0;
  for (int t = 0; t < 600; ++t) {
    const std::int64_t now = kStart_ns + t * kSecond_ns;
    for (const int at : restarts)
      if (at == t) restart(scheduler, c);
    scheduler->setStatus(Status{.utc_ns = now, .north = 0.5 * t});
    if (t < 400) scheduler->offer(sampleTile(t / 7, 3), now);
    if (t == 100 || t == 350) {
      Request request{.kind = t == 100 ? Request::Kind::kRate : Request::Kind::kDetail, .rate_bps = 640};
      request.north_max = request.east_max = 8;
      scheduler->request(request, now);
    }
    if (scheduler->detail() != nullptr && t % 3 == 0) {
      if (t < 380)
        scheduler->offer(sampleTile(t, 3), now, scheduler->detail()->max_error);
      else
        scheduler->detailServed();
    }
    while (const std::size_t size = scheduler->nextFrame(now, frame)) {
      frames.insert(frames.end(), frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(size));
      if (++sent % 6 == 0) continue;
      (void)ship.accept(std::span<const std::uint8_t>(frame).first(size), [](const auto&) { return true; });
      if (ship.turn()) scheduler->acknowledge(ship.acknowledgement(), now);
    }
  }
  return frames;
}

TEST(LinkState, AnAnsweredLinkContinuesWithTheSameFrames) {
  const LinkSchedulerConfig c = stateConfig(true, 300);
  const std::vector<std::uint8_t> whole = dive(c, {});
  ASSERT_GT(whole.size(), 10000u);
  EXPECT_EQ(dive(c, {57, 351, 352, 500}), whole);
}

TEST(LinkState, ALinkWithoutAnswersContinuesWithTheSameRepairFrames) {
  const LinkSchedulerConfig c = stateConfig(false, 300);
  EXPECT_EQ(dive(c, {20, 57, 133, 399}), dive(c, {}));
}

TEST(LinkState, AFastLinkContinuesInTheMiddleOfATile) {
  const LinkSchedulerConfig c = stateConfig(true, 5000);
  EXPECT_EQ(dive(c, {351, 355, 362}), dive(c, {}));
}

TEST(LinkState, FramesThatTheLogLacksAreNotTakenForANewDive) {
  const LinkSchedulerConfig c = stateConfig(true, 300);
  LinkReceiver ship(kOurs);
  std::array<std::uint8_t, kMaxFrameBytes> frame;
  auto scheduler = std::make_unique<LinkScheduler>(c);
  const auto second = [&](LinkScheduler& link, int t) {
    link.offer(sampleTile(t / 7, 3), kStart_ns + t * kSecond_ns);
    while (const std::size_t size = link.nextFrame(kStart_ns + t * kSecond_ns, frame)) {
      (void)ship.accept(std::span<const std::uint8_t>(frame).first(size), [](const auto&) { return true; });
      if (ship.turn()) link.acknowledge(ship.acknowledgement(), kStart_ns + t * kSecond_ns);
    }
  };
  for (int t = 0; t < 100; ++t) second(*scheduler, t);
  const std::vector<std::uint8_t> state = test::savedState(*scheduler);
  for (int t = 100; t < 105; ++t) second(*scheduler, t);  // received by the ship, in no log
  auto again = std::make_unique<LinkScheduler>(c);
  ASSERT_TRUE(load(*again, state));
  again->noteRestart();
  for (int t = 105; t < 200; ++t) second(*again, t);
  EXPECT_EQ(ship.counters().resyncs, 0u);
  EXPECT_LE(ship.counters().lost, 16u);
  EXPECT_EQ(again->counters().acknowledgements_foreign, 0u);
  EXPECT_EQ(again->counters().frames_lost, 0u);
  EXPECT_GT(again->counters().frames_arrived, scheduler->counters().frames_arrived);
}

TEST(LinkState, DamageIsRefusedOrDoesNoHarm) {
  const LinkSchedulerConfig c = stateConfig(true, 300);
  LinkScheduler scheduler(c);
  std::array<std::uint8_t, kMaxFrameBytes> frame;
  for (int t = 0; t < 100; ++t) {
    scheduler.setStatus({});
    scheduler.offer(sampleTile(t / 7, 3), kStart_ns + t * kSecond_ns);
    while (scheduler.nextFrame(kStart_ns + t * kSecond_ns, frame) > 0) continue;
  }
  const std::vector<std::uint8_t> state = test::savedState(scheduler);
  LinkScheduler other(c);
  test::eachRefused(state, 50, [&](auto bytes) { return load(other, bytes); });
  int loads = 0, refused = 0;
  test::eachDamage(state, 150, [&](auto bytes) {
    ++loads;
    if (!load(other, bytes)) {
      ++refused;
      return;
    }
    other.offer(sampleTile(3, 3), kStart_ns + 101 * kSecond_ns);
    for (int k = 0; k < 4; ++k) (void)other.nextFrame(kStart_ns + (101 + 5 * k) * kSecond_ns, frame);
    Acknowledgement acknowledgement{.valid = true, .newest = 5, .before = {}};
    other.acknowledge(acknowledgement, kStart_ns + 130 * kSecond_ns);
  });
  EXPECT_GT(refused, 0);
  EXPECT_LT(refused, loads);
}

TEST(LinkState, ASmallerPoolRefuses) {
  LinkScheduler scheduler(stateConfig(true, 300));
  for (int t = 0; t < 20; ++t) scheduler.offer(sampleTile(t, 3), kStart_ns);
  LinkSchedulerConfig smaller = stateConfig(true, 300);
  smaller.blocks.max_squares = 4;
  LinkScheduler other(smaller);
  EXPECT_FALSE(load(other, test::savedState(scheduler)));
}

TEST(DownlinkState, WhatWasAdmittedBeforeTheRestartStaysOld) {
  const std::array<std::uint8_t, LinkKey::kBytes> secret{1, 2, 3};
  const LinkKey key{secret};
  DownlinkSender ship(kOurs, key);
  Request request{.kind = Request::Kind::kDetail};
  request.north_max = request.east_max = 5;
  ASSERT_TRUE(ship.request(request));
  std::array<std::uint8_t, kMaxFrameBytes> frame;
  const std::size_t size = ship.nextFrame(kStart_ns + 10 * kSecond_ns, frame);
  const auto downlink = std::span<const std::uint8_t>(frame).first(size);
  DownlinkReceiver vehicle(kOurs, key, kStart_ns);
  ASSERT_EQ(vehicle.accept(kStart_ns + 11 * kSecond_ns, downlink).verdict, DownlinkVerdict::kAccepted);

  const std::vector<std::uint8_t> state = test::savedState(vehicle);
  DownlinkReceiver again(kOurs, key, kStart_ns);
  rt::StateReader reader(state);
  ASSERT_TRUE(again.load(reader)) << reader.failure();
  EXPECT_EQ(again.accept(kStart_ns + 12 * kSecond_ns, downlink).verdict, DownlinkVerdict::kOld);
  // The ship repeats it, as it does: a repetition, not a new request.
  const std::size_t next = ship.nextFrame(kStart_ns + 20 * kSecond_ns, frame);
  const auto repeated =
      again.accept(kStart_ns + 21 * kSecond_ns, std::span<const std::uint8_t>(frame).first(next));
  EXPECT_EQ(repeated.verdict, DownlinkVerdict::kAccepted);
  EXPECT_FALSE(repeated.content.request.has_value());
  EXPECT_EQ(again.counters().repeated_requests, 1u);
  EXPECT_EQ(again.counters().requests, 1u);

  DownlinkReceiver other(kOurs, key, kStart_ns);
  test::eachRefused(state, 30, [&](std::span<const std::uint8_t> bytes) {
    rt::StateReader damaged(bytes);
    return other.load(damaged);
  });
}

}  // namespace
}  // namespace fathom::telemetry

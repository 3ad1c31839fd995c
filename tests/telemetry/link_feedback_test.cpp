// The scheduler with a ship that answers.
#include <gtest/gtest.h>

#include "realtime/kernel/memory/heap_counter.hpp"
#include "tests/telemetry/answering_ship.hpp"

namespace fathom::telemetry {
namespace {

TEST(LinkFeedback, EverythingArrivesWithinTheErrorOverALossyLinkAndThenTheLinkIsQuiet) {
  for (const double loss : {0.0, 0.3, 0.5}) {
    LinkScheduler scheduler(someConfig());
    Ship ship;
    for (int n = 0; n < 6; ++n) scheduler.offer(sampleTile(n, 0), ship.now);
    ship.converse(scheduler, 600, loss);
    for (int n = 0; n < 6; ++n) EXPECT_LE(ship.error(sampleTile(n, 0)), 0.0501) << loss;
    EXPECT_TRUE(scheduler.drained());
    EXPECT_EQ(scheduler.counters().blocks_in_flight, 0);
    const auto frames = scheduler.counters().frames;
    ship.converse(scheduler, 60, loss);
    EXPECT_EQ(scheduler.counters().frames, frames);
  }
}

// Walls and pillars of ten metres on every metre: no block of them fits a frame of 32 B.
HeightTile pillars(std::int32_t north) {
  HeightTile tile = sampleTile(north, 0);
  std::mt19937 random(static_cast<unsigned>(north));
  for (auto& node : tile.nodes) node.depth += std::uniform_real_distribution<float>(-5, 5)(random);
  return tile;
}

TEST(LinkFeedback, NoNodeIsShownWorseThanTheErrorWhereTheGroundIsTooRoughForAFrame) {
  for (const bool answers : {true, false}) {
    for (const int colour_bits : {0, 3}) {
      LinkSchedulerConfig config = someConfig(32);
      config.colour_bits = colour_bits;
      LinkScheduler scheduler(config);
      Ship ship;
      constexpr int kTiles = 4;
      for (int n = 0; n < kTiles; ++n) scheduler.offer(pillars(n), ship.now);
      ship.converse(scheduler, 600, 0.2, answers);
      int shown = 0;
      for (int n = 0; n < kTiles; ++n) {
        const HeightTile tile = pillars(n);
        for (const auto& [key, block] : ship.map)
          for (int k = 0; k < MapBlock::kNodes; ++k)
            if (key.north >> 2 == n && block.isSeen(k)) {
              EXPECT_NEAR(block.depth[static_cast<std::size_t>(k)],
                          tile.at((key.north & 3) * 4 + k / 4, key.east * 4 + k % 4).depth, 0.0501);
            }
        shown += ship.shown(n);
      }
      EXPECT_GE(shown, (answers ? 0.75 : 0.6) * kTiles * 256) << "three bytes fewer where nobody answers";
      if (answers) {
        EXPECT_TRUE(scheduler.drained());
        EXPECT_LT(scheduler.counters().blocks.sent, 3U * kTiles * 16)
            << "what does not fit is not sent for ever";
      }
    }
  }
}

TEST(LinkFeedback, ABlockThatFitsAgainIsSentWhole) {
  LinkScheduler scheduler(someConfig(32));
  Ship ship;
  scheduler.offer(pillars(0), ship.now);
  ship.converse(scheduler, 200, 0);
  ASSERT_LT(ship.shown(0), 256);
  scheduler.offer(sampleTile(0, 0), ship.now);
  ship.converse(scheduler, 200, 0);
  EXPECT_LE(ship.error(sampleTile(0, 0)), 0.0501);
}

TEST(LinkFeedback, OnlyWhatChangedBeyondItsBoundIsSentAgain) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  HeightTile tile = sampleTile(0, 0);
  scheduler.offer(tile, ship.now);
  ship.converse(scheduler, 100, 0);
  const auto before = scheduler.counters().blocks.sent;
  for (auto& node : tile.nodes) node.depth += 0.01F;
  scheduler.offer(tile, ship.now);
  ship.converse(scheduler, 100, 0);
  EXPECT_EQ(scheduler.counters().blocks.sent, before);
  for (int i = 4; i < 8; ++i) tile.at(i, 9).depth += 0.5F;  // nodes of one block
  scheduler.offer(tile, ship.now);
  ship.converse(scheduler, 100, 0);
  EXPECT_EQ(scheduler.counters().blocks.sent, before + 1);
  EXPECT_LE(ship.error(tile), 0.0751);
}

TEST(LinkFeedback, SurvivesTheWrapOfTheSequenceNumbers) {
  LinkSchedulerConfig config = someConfig(32, 100000);
  config.housekeeping.share = 1;
  config.housekeeping.status_period_s = 0.1;
  LinkScheduler scheduler(config);
  Ship ship;
  Status status;
  for (int round = 0; scheduler.counters().frames < 66000; ++round) {
    status.utc_ns = ship.now;
    scheduler.setStatus(status);
    if (round % 500 == 0) scheduler.offer(sampleTile(round / 500 % 50, round / 25000), ship.now);
    ship.converse(scheduler, 0.2, 0.2);
    ASSERT_LT(round, 200000);
  }
  ship.converse(scheduler, 60, 0.2);
  EXPECT_EQ(scheduler.counters().acknowledgements_foreign, 0U);
  EXPECT_EQ(ship.receiver.counters().resyncs, 0U);
  EXPECT_EQ(scheduler.counters().blocks_waiting, 0);
}

TEST(LinkFeedback, AShipThatIsSwitchedOnAgainKnowingNothingGetsWhatHadNoWord) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  for (int n = 0; n < 4; ++n) scheduler.offer(sampleTile(n, 0), ship.now);
  ship.converse(scheduler, 120, 0.1);
  for (int n = 4; n < 12; ++n) scheduler.offer(sampleTile(n, 0), ship.now);
  Ship nobody;
  nobody.now = ship.now;
  nobody.converse(scheduler, 300, 1, false);
  ship.now = nobody.now;
  ship.receiver = LinkReceiver();
  ship.converse(scheduler, 300, 0.1);
  for (int n = 0; n < 12; ++n) EXPECT_LE(ship.error(sampleTile(n, 0)), 0.0501) << n;
}

TEST(LinkFeedback, AShipThatHasLostItsFileGetsAgainWhatItHadAcknowledged) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  for (int n = 0; n < 8; ++n) scheduler.offer(sampleTile(n, 0), ship.now);
  ship.converse(scheduler, 300, 0.1);
  ASSERT_TRUE(scheduler.drained());
  ship.receiver = LinkReceiver();
  ship.map.clear();
  Status status{.utc_ns = ship.now};
  scheduler.setStatus(status);  // something to receive
  ship.converse(scheduler, 300, 0.1);
  for (int n = 0; n < 8; ++n) EXPECT_LE(ship.error(sampleTile(n, 0)), 0.0501) << n;
  EXPECT_GE(scheduler.counters().blocks.missed, 8U * 16);
}

TEST(LinkFeedback, AShipThatComesAfterHoursAndNeverAnswersGetsAllInTheEnd) {
  LinkScheduler scheduler(someConfig(32));
  Ship nobody, ship;
  constexpr int kTiles = 60;  // more frames than the vehicle remembers
  for (int n = 0; n < kTiles; ++n) scheduler.offer(sampleTile(n, 0), nobody.now);
  nobody.converse(scheduler, 900, 1, false);
  ASSERT_GT(scheduler.counters().frames, 2 * 512U);
  ship.now = nobody.now;
  ship.converse(scheduler, 1800, 0.3, false);
  for (int n = 0; n < kTiles; ++n) EXPECT_LE(ship.error(sampleTile(n, 0)), 0.1001) << n;
}

TEST(LinkFeedback, GroundThatIsEmptiedGoesThoughItWasEvictedAndItsFrameIsLost) {
  LinkSchedulerConfig config = someConfig();
  config.blocks.max_squares = 4;
  LinkScheduler scheduler(config);
  std::set<std::int32_t> again;
  scheduler.onEvicted([&](const BlockQueue::Whole& square, bool) { again.insert(square.north); });
  Ship ship;
  HeightTile empty = sampleTile(0, 0);
  for (auto& node : empty.nodes) node.coverage = 0;
  for (int n = 0; n < 12; ++n) {  // one after the other out of the pool
    scheduler.offer(sampleTile(n, 0), ship.now);
    ship.converse(scheduler, 60, 0);
  }
  ASSERT_EQ(ship.shown(0), 256);
  scheduler.offer(empty, ship.now);
  ship.converse(scheduler, 20, 1);
  ship.converse(scheduler, 120, 0);
  EXPECT_EQ(ship.shown(0), 0);
  EXPECT_EQ(ship.shown(1), 256);
  EXPECT_TRUE(again.empty());  // all had word before they were evicted
}

TEST(LinkFeedback, AVehicleThatRestartsIsReceivedAgain) {
  Ship ship;
  for (int life = 0; life < 3; ++life) {
    LinkScheduler scheduler(someConfig());
    for (int n = 0; n < 5; ++n) scheduler.offer(sampleTile(n, life), ship.now);
    ship.converse(scheduler, 120, 0.2);
    for (int n = 0; n < 5; ++n) EXPECT_LE(ship.error(sampleTile(n, life)), 0.0501) << life;
  }
  EXPECT_EQ(ship.receiver.counters().resyncs, 2U);
}

TEST(LinkFeedback, WithoutAnswersRepairFramesMakeUpForTheLoss) {
  LinkSchedulerConfig config = someConfig();
  config.half_duplex = false;
  config.loss_rate = 0.3;
  LinkScheduler scheduler(config);
  Ship ship;
  ship.random.seed(21);
  for (int n = 0; n < 30; ++n) scheduler.offer(sampleTile(n, 0), ship.now);
  ship.converse(scheduler, 600, 0.3, false);
  EXPECT_GT(scheduler.counters().repair_frames, 20U);
  EXPECT_GT(ship.receiver.counters().repaired, 8U);
  EXPECT_GE(ship.map.size(), 30U * 16 * 99 / 100);
  EXPECT_TRUE(scheduler.drained());
}

TEST(LinkFeedback, AcknowledgementsOfFramesNeverSentChangeNothing) {
  LinkScheduler scheduler(someConfig());
  std::int64_t now = kStart_ns;
  scheduler.offer(sampleTile(0, 0), now);
  std::array<std::uint8_t, kMaxFrameBytes> buffer;
  int frames = 0;
  for (; frames < 3 && now < kStart_ns + 60 * kSecond_ns; now += kSecond_ns)
    frames += scheduler.nextFrame(now, buffer) > 0 ? 1 : 0;
  const int in_flight = scheduler.counters().blocks_in_flight;
  EXPECT_GT(in_flight, 0);
  std::mt19937 random(2);
  for (int n = 0; n < 1000; ++n) {
    Acknowledgement a{.valid = true,
                      .newest = static_cast<std::uint16_t>(frames + 10 + random() % 60000),
                      .reach = random() % (Acknowledgement::kMaxReach + 1),
                      .before = {}};
    for (std::size_t i = 0; i < a.reach; ++i) a.before[i] = random() % 2 == 0;
    scheduler.acknowledge(a, now);
  }
  EXPECT_EQ(scheduler.counters().blocks_in_flight, in_flight);
  EXPECT_EQ(scheduler.counters().acknowledgements_foreign, 1000U);
}

TEST(LinkFeedback, PauseRateAndStatusRequestsChangeWhatIsSent) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  Request request{.kind = Request::Kind::kPauseMap};
  scheduler.request(request, ship.now);
  scheduler.offer(sampleTile(0, 0), ship.now);
  scheduler.setStatus({});
  ship.converse(scheduler, 60, 0);
  EXPECT_TRUE(ship.map.empty());
  EXPECT_GT(scheduler.counters().status_frames, 0U);
  request.kind = Request::Kind::kResumeMap;
  scheduler.request(request, ship.now);
  ship.converse(scheduler, 60, 0);
  EXPECT_EQ(ship.map.size(), 16U);
  request.kind = Request::Kind::kRate;
  request.rate_bps = 100;
  scheduler.request(request, ship.now);
  EXPECT_EQ(scheduler.counters().rate_bps, 100);
  request.rate_bps = 5;  // out of bounds
  scheduler.request(request, ship.now);
  EXPECT_EQ(scheduler.counters().rate_bps, 100);
  EXPECT_EQ(scheduler.counters().requests_refused, 1U);
}

TEST(LinkFeedback, SendingCallsNoHeap) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  for (int n = 0; n < 20; ++n) scheduler.offer(sampleTile(n, 0), ship.now);
  ship.converse(scheduler, 10, 0.2);
  scheduler.setStatus({});
  std::array<std::uint8_t, kMaxFrameBytes> buffer;
  const rt::ThreadCost before = rt::threadCost();
  int frames = 0;
  for (const std::int64_t end = ship.now + 60 * kSecond_ns; ship.now < end; ship.now += kSecond_ns / 5)
    while (scheduler.nextFrame(ship.now, buffer) > 0) ++frames;
  const rt::ThreadCost cost = rt::threadCost() - before;
  EXPECT_GT(frames, 5);
  EXPECT_EQ(cost.heap_calls, 0U);
}

TEST(LinkFeedback, AFullPoolGivesUpTheSquareNeededLeastAndCountsIt) {
  LinkSchedulerConfig config = someConfig();
  config.blocks.max_squares = 10;
  LinkScheduler scheduler(config);
  Ship ship;
  for (int n = 0; n < 25; ++n) scheduler.offer(sampleTile(n, 0), ship.now);
  EXPECT_EQ(scheduler.counters().squares_held, 10);
  EXPECT_EQ(scheduler.counters().blocks.evicted, 15U * 16);
  ship.converse(scheduler, 300, 0);
  for (int n = 15; n < 25; ++n) EXPECT_LE(ship.error(sampleTile(n, 0)), 0.0501);
  for (int n = 100; n < 110; ++n)
    scheduler.offer(sampleTile(n, 0), ship.now);  // these displace what has arrived
  EXPECT_EQ(scheduler.counters().blocks.evicted, 15U * 16);
}

}  // namespace
}  // namespace fathom::telemetry

// The scheduler with a ship that answers.
#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <vector>

#include "realtime/kernel/heap_counter.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/ship/link_receiver.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kStart_ns = 1'790'000'000 * kSecond_ns;

LinkSchedulerConfig someConfig() {
  LinkSchedulerConfig config;
  config.identity = {7, 1234};
  config.rate_bps = 2000;
  config.frame_bytes = 64;
  config.max_delay_s = 0.2;
  config.colour_bits = 0;
  config.blocks.coarse_spacing = config.blocks.spacing;
  config.blocks.settle_s = 0;
  return config;
}

// The ship: what it holds of the map, its receiver and clock, and the chance that loses frames.
struct Ship {
  std::int64_t now = kStart_ns;
  std::mt19937 random{4};
  LinkReceiver receiver;
  MapPacketDecoder decoder;
  DecodedMapPacket packet;
  std::map<BlockKey, MapBlock> map;
  Report report;
  std::uint16_t health = 0;
  std::set<std::int64_t> track;  // times of the points heard

  void hear(std::span<const std::uint8_t> frame) {
    receiver.accept(frame, [&](const LinkReceiver::Message& message) {
      Status status;
      if (message.type == MessageType::kReport && decodeReport(message.payload, report))
        health = report.health;
      if (message.type == MessageType::kStatus && decodeStatus(message.payload, status))
        health = status.health;
      std::array<TrackPoint, kMaxTrackPoints> points;
      if (message.type == MessageType::kTrack)
        for (std::size_t k = 0, count = decodeTrack(message.payload, points); k < count; ++k)
          track.insert(points[k].utc_ns);
      if (message.type != MessageType::kMapPacket) return true;
      if (!decoder.decode(message.payload, packet)) return false;
      for (const MapBlock& block : packet.blocks) map[block.key] = block;
      return true;
    });
  }
  // Nodes shown of the squares in that row.
  int shown(std::int32_t north) const {
    int count = 0;
    for (const auto& [key, block] : map) count += key.north >> 2 == north ? std::popcount(block.seen) : 0;
    return count;
  }
  // Greatest difference to a tile's nodes; infinite where one is missing.
  double error(const HeightTile& tile) const {
    double worst = 0;
    for (int i = 0; i < HeightTile::kCells; ++i)
      for (int j = 0; j < HeightTile::kCells; ++j) {
        if (tile.at(i, j).coverage == 0) continue;
        const auto found = map.find(
            {*spacingCode(tile.spacing()), tile.north_index * 4 + i / 4, tile.east_index * 4 + j / 4});
        const auto n = static_cast<std::size_t>(i % 4 * 4 + j % 4);
        if (found == map.end() || !found->second.isSeen(static_cast<int>(n))) return INFINITY;
        worst = std::max(worst, std::abs(static_cast<double>(found->second.depth[n] - tile.at(i, j).depth)));
      }
    return worst;
  }
  // Sends for so long; frames are lost by chance, turns are answered at once unless the answer is lost too.
  void converse(LinkScheduler& scheduler, double seconds, double loss, bool answers = true) {
    std::array<std::uint8_t, kMaxFrameBytes> buffer;
    const auto lost = [&] { return random() < loss * 4294967296.0; };
    for (const std::int64_t end = now + std::llround(seconds * 1e9); now < end; now += kSecond_ns / 5)
      while (const std::size_t size = scheduler.nextFrame(now, buffer)) {
        const auto frame = std::span<const std::uint8_t>(buffer).first(size);
        if (lost()) continue;
        hear(frame);
        if (answers && receiver.turn() && !lost()) scheduler.acknowledge(receiver.acknowledgement(), now);
      }
  }
};

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
      LinkSchedulerConfig config = someConfig();
      config.frame_bytes = 32;
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
  LinkSchedulerConfig config = someConfig();
  config.frame_bytes = 32;
  LinkScheduler scheduler(config);
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
  LinkSchedulerConfig config = someConfig();
  config.rate_bps = 100000;
  config.frame_bytes = 32;
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
  Status status;
  status.utc_ns = ship.now;
  scheduler.setStatus(status);  // something to hear
  ship.converse(scheduler, 300, 0.1);
  for (int n = 0; n < 8; ++n) EXPECT_LE(ship.error(sampleTile(n, 0)), 0.0501) << n;
  EXPECT_GE(scheduler.counters().blocks.missed, 8U * 16);
}

TEST(LinkFeedback, AShipThatComesAfterHoursAndNeverAnswersGetsAllInTheEnd) {
  LinkSchedulerConfig config = someConfig();
  config.frame_bytes = 32;
  LinkScheduler scheduler(config);
  Ship nobody, ship;
  constexpr int kTiles = 60;  // more frames than the vehicle remembers
  for (int n = 0; n < kTiles; ++n) scheduler.offer(sampleTile(n, 0), nobody.now);
  nobody.converse(scheduler, 900, 1, false);
  ASSERT_GT(scheduler.counters().frames, 2 * 512U);
  ship.now = nobody.now;
  ship.converse(scheduler, 1800, 0.3, false);
  for (int n = 0; n < kTiles; ++n) EXPECT_LE(ship.error(sampleTile(n, 0)), 0.1001) << n;
}

TEST(LinkFeedback, GroundThatIsEmptiedGoesThoughItGaveWayInThePoolAndItsFrameIsLost) {
  LinkSchedulerConfig config = someConfig();
  config.blocks.max_squares = 4;
  LinkScheduler scheduler(config);
  std::set<std::int32_t> again;
  scheduler.onGaveWay([&](const BlockQueue::Whole& square, bool) { again.insert(square.north); });
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
  EXPECT_TRUE(again.empty());  // all had word before they gave way
}

TEST(LinkFeedback, AVehicleThatRestartsIsHeardAgain) {
  Ship ship;
  for (int life = 0; life < 3; ++life) {
    LinkScheduler scheduler(someConfig());
    for (int n = 0; n < 5; ++n) scheduler.offer(sampleTile(n, life), ship.now);
    ship.converse(scheduler, 120, 0.2);
    for (int n = 0; n < 5; ++n) EXPECT_LE(ship.error(sampleTile(n, life)), 0.0501) << life;
  }
  EXPECT_EQ(ship.receiver.counters().resyncs, 2U);
}

TEST(LinkFeedback, WithoutAnyoneWhoAnswersRepairFramesMakeUpForTheLoss) {
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
    Acknowledgement a;
    a.valid = true;
    a.newest = static_cast<std::uint16_t>(frames + 10 + random() % 60000);
    a.reach = random() % (Acknowledgement::kMaxReach + 1);
    for (std::size_t i = 0; i < a.reach; ++i) a.before[i] = random() % 2 == 0;
    scheduler.acknowledge(a, now);
  }
  EXPECT_EQ(scheduler.counters().blocks_in_flight, in_flight);
  EXPECT_EQ(scheduler.counters().acknowledgements_foreign, 1000U);
}

TEST(LinkFeedback, PauseRateAndStatusRequestsChangeWhatIsSent) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  Request request;
  request.kind = Request::Kind::kPauseMap;
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

TEST(LinkFeedback, RequestedDetailIsDoneWhenTheShipHasAllOfItThoughFramesAreLost) {
  for (const double rate : {300.0, 5000.0}) {
    LinkSchedulerConfig config = someConfig();
    config.rate_bps = rate;
    LinkScheduler scheduler(config);
    Ship ship;
    Request request;
    request.kind = Request::Kind::kDetail;
    request.id = 5;
    request.north_max = request.east_max = 2;
    request.spacing = 0.125;
    request.max_error = 0.02;
    scheduler.request(request, ship.now, 1234);
    ASSERT_NE(scheduler.detail(), nullptr);
    const HeightTile tile = sampleTile(0, 0, 2);
    scheduler.offer(tile, ship.now, scheduler.detail()->max_error);
    scheduler.detailServed();
    EXPECT_EQ(scheduler.detail(), nullptr);
    bool early = false;
    for (int k = 0; k < 400; ++k) {
      ship.converse(scheduler, 1, 0.3);
      const auto& said = ship.report.requests[0];
      if (said.state != RequestOutcome::State::kDone) continue;
      EXPECT_EQ(said.id, 5);
      EXPECT_EQ(said.counter, 1234U & 1023U);
      early = ship.error(tile) > 0.0201;
      break;
    }
    EXPECT_FALSE(early);
    EXPECT_EQ(ship.report.requests[0].state, RequestOutcome::State::kDone);
    EXPECT_LE(ship.error(tile), 0.0201);
  }
}

TEST(LinkFeedback, TheTrackHasNoGapsAfterAnHourInWhichTheShipWasOffAndThoughItLosesWhatItHeld) {
  LinkSchedulerConfig config = someConfig();
  config.frame_bytes = 128;
  LinkScheduler scheduler(config);
  Ship ship;
  const auto dive = [&](double seconds, double loss, bool answers) {
    for (int k = 0; k < seconds / 5; ++k) {
      Status status;
      status.utc_ns = ship.now;
      status.north = static_cast<double>(ship.now - kStart_ns) * 0.4e-9;
      status.east = 10 * std::sin(status.north / 30);
      scheduler.setStatus(status);
      ship.converse(scheduler, 5, loss, answers);
    }
  };
  // The longest time between two points of the track, the ends of the dive included [s].
  const auto gap = [&] {
    std::int64_t longest = 0, before = kStart_ns;
    for (const std::int64_t at : ship.track) {
      longest = std::max(longest, at - before);
      before = at;
    }
    return static_cast<double>(std::max(longest, ship.now - before)) * 1e-9;
  };
  dive(600, 0.3, true);
  dive(3 * 3600, 1, false);  // more frames than the vehicle remembers
  EXPECT_GT(gap(), 3 * 3000);
  dive(1800, 0.3, true);
  EXPECT_LE(gap(), 130) << "what is of this moment may still be on its way";
  // Its file is lost: it says so itself, from the beginning of the dive on.
  ship.receiver = LinkReceiver();
  ship.track.clear();
  dive(300, 0, true);
  for (int k = 0; k < 200; ++k) {
    dive(10, 0, true);
    if (const auto further = ship.receiver.furtherAcknowledgement(true))
      scheduler.acknowledge(*further, ship.now);
  }
  EXPECT_LE(gap(), 130);
}

// However much waits, the ship hears of a new health flag, a pause and its end within two turns.
TEST(LinkFeedback, NewsOvertakeAnyBacklog) {
  std::mt19937 random(9);
  int over = 0, seen = 0;
  double longest_s = 0;
  for (const int frame_bytes : {32, 64, 128, 256})
    for (const double rate : {80.0, 300.0, 1200.0, 5400.0})
      for (const double loss : {0.0, 0.3}) {
        LinkSchedulerConfig config = someConfig();
        config.frame_bytes = frame_bytes;
        config.rate_bps = rate;
        config.max_delay_s = 1;
        LinkScheduler scheduler(config);
        Ship ship;
        ship.random.seed(random());
        for (int n = 0; n < 64; ++n) scheduler.offer(sampleTile(n / 8, n % 8), ship.now);
        Status status;
        scheduler.setStatus(status);
        ship.converse(scheduler, 200, loss);
        for (int k = 0; k < 12; ++k) {
          for (int n = 0; n < 64; ++n) scheduler.offer(sampleTile(k * 8 + n / 8, n % 8), ship.now);
          const std::uint64_t turns = scheduler.counters().turns;
          Request request;
          request.id = static_cast<std::uint8_t>(k);
          request.kind = k % 3 == 1 ? Request::Kind::kPauseMap : Request::Kind::kResumeMap;
          if (k % 3 == 0) {
            status.health = static_cast<std::uint16_t>(status.health ^ 1U << k);
            scheduler.setStatus(status);
          } else {
            scheduler.request(request, ship.now);
          }
          const auto isSeen = [&] {
            return k % 3 == 0 ? ship.health == status.health : ship.report.paused == (k % 3 == 1);
          };
          const std::int64_t from = ship.now;
          while (!isSeen() && ship.now - from < 600 * kSecond_ns) ship.converse(scheduler, 0.2, loss);
          ++seen;
          if (scheduler.counters().turns - turns > 2) ++over;
          if (loss == 0)
            longest_s =
                std::max(longest_s, static_cast<double>(ship.now - from) * 1e-9 * rate / frame_bytes / 8);
          if (loss == 0) {
            EXPECT_LE(scheduler.counters().turns - turns, 2U) << frame_bytes << ' ' << rate << ' ' << k;
          }
          ship.converse(scheduler, 30, loss);
        }
      }
  std::printf("%d news, %d later than two turns; without loss at most %.1f frames later\n", seen, over,
              longest_s);
  EXPECT_LT(over, seen / 20) << "with three frames in ten lost, either way";
}

// The vehicle's program is behind the clock, now more, now less. Answers that find it speaking are lost.
TEST(LinkFeedback, AnswersFindTheVehicleListeningHoweverFarItsProgramIsBehind) {
  for (const bool told : {false, true}) {
    LinkSchedulerConfig config = someConfig();
    config.rate_bps = 600;
    config.max_delay_s = 1;
    LinkScheduler scheduler(config);
    LinkReceiver receiver;
    std::mt19937 random(3);
    std::array<std::uint8_t, kMaxFrameBytes> buffer;
    struct Answer {
      std::int64_t at_ns = 0;
      Acknowledgement content;
    };
    std::optional<Answer> answer;
    std::vector<std::pair<std::int64_t, Version>> leaving;
    std::int64_t lag_ns = kSecond_ns / 10, last_left_ns = 0, last_given_ns = 0;
    int answers = 0, missed = 0;
    for (std::int64_t now = kStart_ns; now < kStart_ns + 3600 * kSecond_ns; now += kSecond_ns / 20) {
      if (random() % 100 == 0) lag_ns = kSecond_ns * static_cast<std::int64_t>(random() % 25) / 10;
      if (random() % 40 == 0)
        scheduler.offer(sampleTile(static_cast<int>(random() % 30), 0, 4, 1, static_cast<unsigned>(random())),
                        now);
      for (; !leaving.empty() && leaving.front().first <= now; leaving.erase(leaving.begin()))
        if (told) scheduler.noteSent(leaving.front().second, leaving.front().first);
      if (answer && answer->at_ns <= now) {
        ++answers;
        if (last_left_ns > answer->at_ns - kSecond_ns / 2)
          ++missed;
        else
          scheduler.acknowledge(answer->content, now);
        answer.reset();
      }
      while (const std::size_t size = scheduler.nextFrame(now, buffer)) {
        const std::int64_t given_ns = std::max(now + lag_ns, last_given_ns);
        last_given_ns = given_ns;
        const std::int64_t left_ns =
            std::max(given_ns, last_left_ns) + static_cast<std::int64_t>(size) * 8 * kSecond_ns / 600;
        last_left_ns = left_ns;
        receiver.accept(std::span(buffer).first(size), [](const auto&) { return true; });
        if (!receiver.turn()) continue;
        answer = Answer{left_ns + 2 * kSecond_ns + kSecond_ns / 2, receiver.acknowledgement()};
        leaving.emplace_back(given_ns,
                             versionNear(receiver.acknowledgement().newest, SentFrames::kFirst) + 1);
      }
    }
    std::printf("%s when turns left: %d of %d answers missed\n", told ? "told" : "not told", missed, answers);
    EXPECT_GT(answers, 80);
    if (told) {
      EXPECT_LE(missed, answers / 50);
    } else {
      EXPECT_GT(missed, answers / 10) << "or this test shows nothing";
    }
  }
}

TEST(LinkFeedback, APauseEndsAndTheConfiguredRateHoldsAgainWhenNobodyHasSpokenForTenMinutes) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  Request request;
  request.kind = Request::Kind::kPauseMap;
  scheduler.request(request, ship.now);
  request.kind = Request::Kind::kRate;
  request.rate_bps = 80;
  scheduler.request(request, ship.now);
  scheduler.setStatus({});
  ship.converse(scheduler, 1800, 0);
  EXPECT_TRUE(scheduler.counters().paused);
  EXPECT_EQ(scheduler.counters().rate_bps, 80);
  ship.converse(scheduler, 560, 0, false);
  EXPECT_TRUE(scheduler.counters().paused);
  ship.converse(scheduler, 60, 0, false);
  EXPECT_FALSE(scheduler.counters().paused);
  EXPECT_EQ(scheduler.counters().rate_bps, someConfig().rate_bps);
}

// The ship goes on to speak, but hears nothing any more.
TEST(LinkFeedback, ARateAtWhichNothingArrivesIsGivenUp) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  scheduler.offer(sampleTile(0, 0), ship.now);
  ship.converse(scheduler, 60, 0);
  Request request;
  request.kind = Request::Kind::kRate;
  request.rate_bps = 9000;
  scheduler.request(request, ship.now);
  const Acknowledgement before = ship.receiver.acknowledgement();
  for (int k = 0; k < 12; ++k) {
    EXPECT_EQ(scheduler.counters().rate_bps, k < 11 ? 9000 : someConfig().rate_bps) << k;
    ship.converse(scheduler, 60, 1);
    scheduler.acknowledge(before, ship.now);
  }
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

// What overtakes the map: reports, requests and their answers, turns, the track.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include "tests/telemetry/answering_ship.hpp"

namespace fathom::telemetry {
namespace {

TEST(LinkRequests, RequestedDetailIsDoneWhenTheShipHasAllOfItThoughFramesAreLost) {
  for (const double rate : {300.0, 5000.0}) {
    LinkScheduler scheduler(someConfig(64, rate));
    Ship ship;
    Request request{.kind = Request::Kind::kDetail, .id = 5};
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

TEST(LinkRequests, TheTrackHasNoGapsAfterAnHourInWhichTheShipWasOffAndThoughItLosesWhatItHeld) {
  LinkScheduler scheduler(someConfig(128));
  Ship ship;
  const auto dive = [&](double seconds, double loss, bool answers) {
    for (int k = 0; k < seconds / 5; ++k) {
      Status status{.utc_ns = ship.now, .north = static_cast<double>(ship.now - kStart_ns) * 0.4e-9};
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
  EXPECT_LE(gap(), 130) << "what is of this moment may still be in transit";
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

// However much waits, the ship receives a new health flag, a pause and its end within two turns.
TEST(LinkRequests, NewsOvertakeAnyBacklog) {
  std::mt19937 random(9);
  int over = 0, seen = 0;
  double longest_s = 0;
  for (const int frame_bytes : {32, 64, 128, 256})
    for (const double rate : {80.0, 300.0, 1200.0, 5400.0})
      for (const double loss : {0.0, 0.3}) {
        LinkSchedulerConfig config = someConfig(frame_bytes, rate);
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
  EXPECT_LT(over, seen / 20) << "with three frames in ten lost, up and down";
}

// The vehicle's program is behind the clock, now more, now less. Answers that arrive while it sends are lost.
TEST(LinkRequests, AnswersFindTheVehicleListeningHoweverFarItsProgramIsBehind) {
  for (const bool departures_known : {false, true}) {
    LinkSchedulerConfig config = someConfig(64, 600);
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
        if (departures_known) scheduler.noteSent(leaving.front().second, leaving.front().first);
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
    std::printf("departure of turns %s: %d of %d answers missed\n", departures_known ? "known" : "unknown",
                missed, answers);
    EXPECT_GT(answers, 80);
    if (departures_known) {
      EXPECT_LE(missed, answers / 50);
    } else {
      EXPECT_GT(missed, answers / 10) << "or this test shows nothing";
    }
  }
}

TEST(LinkRequests, APauseEndsAndTheConfiguredRateHoldsAgainWhenNobodyHasSpokenForTenMinutes) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  Request request{.kind = Request::Kind::kPauseMap};
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

// The ship still speaks, but receives nothing any more.
TEST(LinkRequests, ARateAtWhichNothingArrivesIsGivenUp) {
  LinkScheduler scheduler(someConfig());
  Ship ship;
  scheduler.offer(sampleTile(0, 0), ship.now);
  ship.converse(scheduler, 60, 0);
  scheduler.request(Request{.kind = Request::Kind::kRate, .rate_bps = 9000}, ship.now);
  const Acknowledgement before = ship.receiver.acknowledgement();
  for (int k = 0; k < 12; ++k) {
    EXPECT_EQ(scheduler.counters().rate_bps, k < 11 ? 9000 : someConfig().rate_bps) << k;
    ship.converse(scheduler, 60, 1);
    scheduler.acknowledge(before, ship.now);
  }
}

}  // namespace
}  // namespace fathom::telemetry

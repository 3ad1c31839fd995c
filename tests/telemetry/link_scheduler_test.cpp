#include "telemetry/vehicle/link_scheduler.hpp"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/uplink_messages.hpp"
#include "tests/telemetry/sample_frames.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::telemetry {
namespace {

struct Sent {
  std::int64_t time_ns;
  std::vector<std::uint8_t> bytes;
  [[nodiscard]] MessageType type() const { return decodeFrame(bytes).header.type; }
};

LinkSchedulerConfig uplinkOnlyConfig() {
  LinkSchedulerConfig made;
  made.identity = kOurs;
  made.half_duplex = false;
  return made;
}

Status statusAt(std::int64_t now_ns) {
  return Status{.utc_ns = now_ns, .north = 0.5 * static_cast<double>(now_ns - kStart_ns) / 1e9, .depth = 30};
}

// Runs the scheduler for `seconds` in steps of `step_s`, with a status every step and `each_step` called
// before it.
template <class EachStep>
std::vector<Sent> run(LinkScheduler& scheduler, double seconds, double step_s, EachStep each_step,
                      std::int64_t start_ns = kStart_ns) {
  std::vector<Sent> sent;
  std::array<std::uint8_t, kMaxModemBytes> buffer;
  for (double t = 0; t < seconds; t += step_s) {
    const std::int64_t now = start_ns + std::llround(t * 1e9);
    each_step(t);
    scheduler.setStatus(statusAt(now));
    for (std::size_t size; (size = scheduler.nextFrame(now, buffer)) > 0;)
      sent.push_back({now, {buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(size)}});
  }
  return sent;
}

TEST(LinkScheduler, NeverExceedsItsRateOverAnyWindowAndUsesIt) {
  for (const double rate : {80.0, 300.0, 1200.0}) {
    for (const int frame_bytes : {32, 100, 256}) {
      LinkSchedulerConfig config = uplinkOnlyConfig();
      config.rate_bps = rate;
      config.frame_bytes = frame_bytes;
      LinkScheduler scheduler(config);
      scheduler.setMissionInfo({"sirius", {}, kStart_ns, 0});
      const auto bucket = static_cast<double>(linkBucketBits(config));
      int n = 0;
      const auto sent = run(scheduler, 300, 0.37, [&](double) {
        for (int k = 0; k < 2; ++k) scheduler.offer(sampleTile(n++, 3), kStart_ns);
      });
      // Over every window from frame i to frame j: bits(i..j) <= rate * (t_j - t_i) + bucket. The greatest
      // excess of any window that ends here follows from the one that ends a frame earlier.
      double total = 0, excess = 0;
      std::int64_t last_ns = sent.front().time_ns;
      for (const Sent& s : sent) {
        ASSERT_LE(s.bytes.size(), static_cast<std::size_t>(frame_bytes));
        const double bits = static_cast<double>(s.bytes.size()) * 8;
        excess = std::max(0.0, excess - rate * static_cast<double>(s.time_ns - last_ns) / 1e9) + bits;
        last_ns = s.time_ns;
        ASSERT_LE(excess, bucket + 1e-6);
        total += bits;
      }
      EXPECT_GT(total, 0.95 * rate * 300) << rate << " bit/s, " << frame_bytes << " B";
    }
  }
}

// The modem that a scheduler is configured for.
struct Modem {
  int frame_bytes = 128, modem_bytes = 0;
  bool padded = false;
  double preamble_s = 0;
};
constexpr std::array<Modem, 6> kModems = {{{32, 64, false, 0},
                                           {32, 64, true, 0.4},
                                           {32, 300, true, 0},
                                           {128, 512, false, 2},
                                           {256, 2048, false, 0},
                                           {128, 2048, true, 5}}};

LinkSchedulerConfig configFor(const Modem& modem) {
  LinkSchedulerConfig config = uplinkOnlyConfig();
  config.frame_bytes = modem.frame_bytes;
  config.modem_bytes = modem.modem_bytes;
  config.padded = modem.padded;
  config.preamble_s = modem.preamble_s;
  return config;
}

std::vector<DecodedFrame> linkFrames(const Sent& sent) {
  std::vector<DecodedFrame> all;
  LinkFrames frames(sent.bytes);
  while (const auto frame = frames.next()) all.push_back(decodeFrame(*frame));
  return all;
}

TEST(LinkScheduler, FillsTheModemsFramesWithWholeLinkFrames) {
  for (const Modem& modem : kModems) {
    LinkScheduler scheduler(configFor(modem));
    for (int n = 0; n < 300; ++n) scheduler.offer(sampleTile(n, 0), kStart_ns);
    const auto sent = run(scheduler, 600, 0.5, [](double) {});
    ASSERT_FALSE(sent.empty());
    std::map<MessageType, int> types;
    int frames = 0;
    std::size_t bytes = 0;
    for (const Sent& s : sent) {
      ASSERT_LE(s.bytes.size(), static_cast<std::size_t>(modem.modem_bytes));
      if (modem.padded) {
        EXPECT_EQ(s.bytes.size(), static_cast<std::size_t>(modem.modem_bytes));
      }
      for (const DecodedFrame& frame : linkFrames(s)) {
        ASSERT_EQ(frame.verdict, FrameVerdict::kAccepted);
        ++types[frame.header.type];
        ++frames;
      }
      bytes += s.bytes.size();
    }
    // As many as there is room for: none is shorter than that by a link frame.
    const double full = static_cast<double>(modem.modem_bytes - modem.frame_bytes - 2);
    EXPECT_GE(static_cast<double>(bytes) / static_cast<double>(sent.size()),
              modem.padded ? full : 0.95 * full);
    EXPECT_GT(types[MessageType::kMapPacket], 0);
    EXPECT_GT(types[MessageType::kStatus], 0);
    const LinkScheduler::Counters c = scheduler.counters();
    EXPECT_EQ(c.frames, static_cast<std::uint64_t>(frames));
    EXPECT_EQ(c.bytes, bytes);
  }
}

TEST(LinkScheduler, CountsEverythingThatAModemFrameTakesOfTheRate) {
  for (const Modem& modem : kModems) {
    for (const double duty : {1.0, 0.4}) {
      LinkSchedulerConfig config = configFor(modem);
      config.duty = duty;
      LinkScheduler scheduler(config);
      int n = 0;
      const auto sent = run(scheduler, 1500, 0.37, [&](double) {
        for (int k = 0; k < 2; ++k) scheduler.offer(sampleTile(n++, 3), kStart_ns);
      });
      double total = 0, excess = 0;
      std::int64_t last_ns = sent.front().time_ns;
      const auto bucket = static_cast<double>(linkBucketBits(config));
      for (const Sent& s : sent) {
        const double bits = static_cast<double>(s.bytes.size()) * 8 + config.preamble_s * config.rate_bps;
        excess =
            std::max(0.0, excess - config.rate_bps * duty * static_cast<double>(s.time_ns - last_ns) / 1e9) +
            bits;
        last_ns = s.time_ns;
        ASSERT_LE(excess, bucket + 1e-6);
        total += bits;
      }
      EXPECT_GT(total, 0.9 * config.rate_bps * duty * 1500) << modem.modem_bytes << " B, duty " << duty;
    }
  }
}

TEST(LinkScheduler, GivesTheTurnWithTheLastLinkFrameAndListensAsLongAsTheModemsNeed) {
  for (const Modem& modem : kModems) {
    LinkSchedulerConfig config = configFor(modem);
    config.half_duplex = true;
    LinkScheduler scheduler(config);
    for (int n = 0; n < 300; ++n) scheduler.offer(sampleTile(n, 0), kStart_ns);
    const auto sent = run(scheduler, 3000, 0.5, [](double) {});
    // The vehicle's own modem: one frame after the other, each with its preamble.
    const auto air_s = [&](std::size_t bytes) {
      return modem.preamble_s + static_cast<double>(bytes) * 8 / config.rate_bps;
    };
    double free_s = 0, quiet_until_s = 0;
    int turns = 0;
    for (const Sent& s : sent) {
      const double now_s = static_cast<double>(s.time_ns - kStart_ns) / 1e9;
      EXPECT_GE(now_s, quiet_until_s - 1e-6);
      EXPECT_LE(free_s - now_s, std::max(1.0, air_s(static_cast<std::size_t>(modem.modem_bytes))) + 1e-6)
          << "more than one frame waits";
      free_s = std::max(free_s, now_s) + air_s(s.bytes.size());
      const auto frames = linkFrames(s);
      for (std::size_t i = 0; i < frames.size(); ++i) {
        if (!frames[i].header.turn) continue;
        EXPECT_EQ(i + 1, frames.size());
        ++turns;
        const std::size_t answer =
            modem.padded ? static_cast<std::size_t>(modem.modem_bytes) : kMinFrameBytes;
        quiet_until_s = free_s + 2 * config.max_delay_s + air_s(answer);
      }
    }
    EXPECT_GE(turns, 3) << modem.modem_bytes;
  }
}

TEST(LinkScheduler, SendsStatusEveryPeriodEvenWithTilesWaiting) {
  LinkSchedulerConfig config = uplinkOnlyConfig();
  config.housekeeping.share = 0.3;
  LinkScheduler scheduler(config);
  for (int n = 0; n < 200; ++n) scheduler.offer(sampleTile(n, 0), kStart_ns);
  const auto sent = run(scheduler, 600, 0.5, [](double) {});
  ASSERT_EQ(scheduler.counters().periods_stretched, 1);
  std::int64_t last = kStart_ns;
  int count = 0;
  for (const Sent& s : sent) {
    if (s.type() != MessageType::kStatus) continue;
    EXPECT_LE(s.time_ns - last, 16 * kSecond_ns);  // the period and at most one frame that is sent
    last = s.time_ns;
    ++count;
  }
  EXPECT_GE(count, 40);
}

TEST(LinkScheduler, KeepsHousekeepingToItsShareOnASlowLink) {
  LinkSchedulerConfig config = uplinkOnlyConfig();
  config.rate_bps = 80;
  config.frame_bytes = 32;
  LinkScheduler scheduler(config);
  scheduler.setMissionInfo({"sirius", {}, kStart_ns, 0});
  int n = 0;
  const auto sent = run(scheduler, 3600, 0.5, [&](double t) {
    if (n < t) scheduler.offer(sampleTile(n++, 0), kStart_ns);
  });
  double housekeeping = 0, all = 0;
  std::set<MessageType> types;
  for (const Sent& s : sent) {
    types.insert(s.type());
    all += static_cast<double>(s.bytes.size());
    if (s.type() == MessageType::kStatus || s.type() == MessageType::kMissionInfo)
      housekeeping += static_cast<double>(s.bytes.size());
  }
  EXPECT_GT(scheduler.counters().periods_stretched, 1);
  EXPECT_LT(housekeeping / all, config.housekeeping.share + 0.02);
  EXPECT_TRUE(types.contains(MessageType::kStatus) && types.contains(MessageType::kMissionInfo));
  EXPECT_FALSE(types.contains(MessageType::kTrack));  // a frame holds but two points: status says as much
}

TEST(LinkScheduler, TheTrackHasNoHoleWhenAFifthOfTheFramesAreLost) {
  LinkSchedulerConfig config = uplinkOnlyConfig();
  config.loss_rate = 0.2;
  config.housekeeping.share = 0.3;
  LinkScheduler scheduler(config);
  for (int n = 0; n < 300; ++n) scheduler.offer(sampleTile(n, 0), kStart_ns);
  const auto sent = run(scheduler, 3000, 0.5, [](double) {});
  std::mt19937 random(99);
  std::set<std::int64_t> times;
  for (const Sent& s : sent) {
    std::array<TrackPoint, kMaxTrackPoints> points;
    if (s.type() != MessageType::kTrack || random() % 5 == 0) continue;
    const std::size_t count = decodeTrack(decodeFrame(s.bytes).payload, points);
    ASSERT_GT(count, 0U);
    for (std::size_t i = 0; i < count; ++i) times.insert(points[i].utc_ns);
  }
  ASSERT_GT(times.size(), 400U);
  std::int64_t last = *times.begin();
  for (const std::int64_t t : times) {
    EXPECT_LE(t - last, 11 * kSecond_ns);  // at most one point of one in five is lost twice
    last = t;
  }
}

TEST(LinkScheduler, SameCallsGiveTheSameBytes) {
  const auto once = [] {
    LinkScheduler scheduler(uplinkOnlyConfig());
    scheduler.setMissionInfo({"sirius", {0.3, -0.2}, kStart_ns, 0});
    int n = 0;
    std::vector<std::uint8_t> all;
    for (const Sent& s : run(scheduler, 300, 0.5, [&](double) {
           scheduler.offer(sampleTile(n % 20, n / 20, 4, 0.5 + 0.5 * (n % 2)), kStart_ns);
           ++n;
         }))
      all.insert(all.end(), s.bytes.begin(), s.bytes.end());
    return all;
  };
  EXPECT_EQ(once(), once());
}

TEST(LinkScheduler, RefusesAConfigurationThatMakesNoSense) {
  const auto refuses = [](auto change) {
    LinkSchedulerConfig config = uplinkOnlyConfig();
    change(config);
    EXPECT_THROW(LinkScheduler{config}, std::invalid_argument);
  };
  refuses([](auto& c) { c.rate_bps = 0; });
  refuses([](auto& c) { c.rate_bps = NAN; });
  refuses([](auto& c) { c.frame_bytes = 31; });
  refuses([](auto& c) { c.frame_bytes = 257; });
  refuses([](auto& c) { c.modem_bytes = 63; });
  refuses([](auto& c) { c.modem_bytes = 129; });  // a link frame of 128 B, and two bytes around it
  refuses([](auto& c) { c.modem_bytes = 2049; });
  refuses([](auto& c) { c.padded = true; });
  refuses([](auto& c) { c.preamble_s = 5.1; });
  refuses([](auto& c) { c.preamble_s = -1; });
  refuses([](auto& c) { c.preamble_s = 5, c.rate_bps = 1e6; });
  refuses([](auto& c) { c.loss_rate = 1; });
  refuses([](auto& c) { c.colour_bits = 7; });
  refuses([](auto& c) { c.duty = 0; });
  refuses([](auto& c) { c.blocks.coarse_spacing = 0.3; });
  refuses([](auto& c) { c.blocks.spacing = c.blocks.coarse_spacing = 0.33333; });
  refuses([](auto& c) { c.blocks.max_error = 0; });
  refuses([](auto& c) { c.blocks.max_squares = 0; });
  refuses([](auto& c) { c.housekeeping.share = 0; });
}

TEST(Repeats, AreTheLeastThatReachTheGoal) {
  EXPECT_EQ(repeatsForGoal(0, 0.99), 1);
  EXPECT_EQ(repeatsForGoal(0.1, 0.99), 2);
  for (const double loss : {0.05, 0.2, 0.5, 0.9})
    for (const double goal : {0.6, 0.95, 0.999}) {
      const int n = repeatsForGoal(loss, goal);
      EXPECT_GE(1 - std::pow(loss, n), goal - 1e-6);
      if (n > 1) {
        EXPECT_LT(1 - std::pow(loss, n - 1), goal);
      }
    }
}

}  // namespace
}  // namespace fathom::telemetry

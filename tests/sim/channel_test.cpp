#include "sim/link/channel.hpp"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <thread>

#include "firmware_if/devices/modem/modem_ports.hpp"

namespace fathom::sim {
namespace {

ChannelConfig clearWater() {
  return {.loss = 0,
          .duplicate = 0,
          .reorder = 0,
          .corrupt = 0,
          .delay_s = 0,
          .rate_bps = 0,
          .queue_frames = 64,
          .seed = 5};
}

std::vector<std::uint8_t> frameOf(int number, std::size_t size = 40) {
  std::vector<std::uint8_t> frame(size);
  for (std::size_t i = 0; i < size; ++i)
    frame[i] = static_cast<std::uint8_t>(static_cast<std::size_t>(number) * 7 + i);
  frame[0] = static_cast<std::uint8_t>(number), frame[1] = static_cast<std::uint8_t>(number >> 8);
  return frame;
}

int numberOf(std::span<const std::uint8_t> frame) {
  return frame[0] | frame[1] << 8;
}

using Buffer = std::array<std::uint8_t, FramePort::kMaxFrameBytes>;

TEST(Channel, ClearWaterDeliversEveryFrameInOrderAndWhole) {
  AcousticChannel channel(clearWater());
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(channel.send(i * 0.1, frameOf(i)));
  Buffer buffer;
  for (int i = 0; i < 50; ++i) {
    const std::size_t size = channel.receive(10.0, buffer);
    EXPECT_EQ(std::vector(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(size)), frameOf(i));
  }
  EXPECT_EQ(channel.receive(10.0, buffer), 0U);
  EXPECT_LT(channel.nextArrival(), 0);
}

TEST(Channel, AFrameArrivesAfterItsTransmissionAndTheDelay) {
  ChannelConfig config = clearWater();
  config.rate_bps = 320;  // 40 bytes a second
  config.delay_s = 2.0;
  AcousticChannel channel(config);
  ASSERT_TRUE(channel.send(1.0, frameOf(0)));
  ASSERT_TRUE(channel.send(1.0, frameOf(1)));
  Buffer buffer;
  EXPECT_NEAR(channel.nextArrival(), 4.0, 1e-9);
  EXPECT_EQ(channel.receive(3.99, buffer), 0U);
  EXPECT_EQ(channel.receive(4.0, buffer), 40U);
  EXPECT_EQ(channel.receive(4.99, buffer), 0U);
  EXPECT_EQ(channel.receive(5.0, buffer), 40U);
}

TEST(Channel, AFullQueueAndFramesOfWrongSizeAreRefusedAndCounted) {
  ChannelConfig config = clearWater();
  config.rate_bps = 320;
  config.queue_frames = 2;
  AcousticChannel channel(config);
  EXPECT_TRUE(channel.send(0.0, frameOf(0)));
  EXPECT_TRUE(channel.send(0.0, frameOf(1)));
  EXPECT_FALSE(channel.send(0.5, frameOf(2)));
  EXPECT_TRUE(channel.send(1.1, frameOf(3)));
  EXPECT_FALSE(channel.send(20.0, frameOf(4, FramePort::kMaxFrameBytes + 1)));
  EXPECT_FALSE(channel.send(20.0, {}));
  EXPECT_EQ(channel.counters().refused, 3U);
}

TEST(Channel, LossDuplicationReorderingAndDamageComeAtTheirRates) {
  ChannelConfig config = clearWater();
  config.loss = 0.1, config.duplicate = 0.05, config.reorder = 0.04, config.corrupt = 0.03;
  config.delay_s = 1.0;
  AcousticChannel channel(config);
  constexpr int kFrames = 20000;
  Buffer buffer;
  std::vector<int> arrivals(kFrames);
  int damaged = 0, late = 0, last = -1;
  for (int i = 0; i < kFrames + 100; ++i) {
    if (i < kFrames) {
      ASSERT_TRUE(channel.send(i * 0.1, frameOf(i)));
    }
    while (const std::size_t size = channel.receive(i * 0.1, buffer)) {
      const auto frame = std::span(buffer).first(size);
      const int number = numberOf(frame);
      const bool whole = number < kFrames && std::vector(frame.begin(), frame.end()) == frameOf(number);
      damaged += !whole;
      if (!whole) continue;
      ++arrivals[static_cast<std::size_t>(number)];
      late += number < last;
      last = std::max(last, number);
    }
  }
  int none = 0, twice = 0;
  for (int n : arrivals) none += n == 0, twice += n == 2;
  const auto near = [](int count, double probability) {
    EXPECT_NEAR(count, kFrames * probability, 5 * std::sqrt(kFrames * probability));
  };
  const double arrives = 1 - config.loss, whole = arrives * (1 - config.corrupt);
  near(none, config.loss + arrives * config.corrupt);
  near(twice, whole * config.duplicate);
  near(damaged, arrives * config.corrupt * (1 + config.duplicate));
  near(late, whole * (config.reorder + config.duplicate));
}

TEST(Channel, BurstsHaveTheirMeanLengthAndTheSameLoss) {
  for (const double loss : {0.1, 0.3, 0.5})
    for (const double burst : {2.0, 5.0, 12.0}) {
      ChannelConfig config = clearWater();
      config.loss = loss;
      config.mean_burst = burst;
      AcousticChannel channel(config);
      constexpr int kFrames = 60000;
      Buffer buffer;
      int lost = 0, runs = 0;
      bool before = false;
      for (int i = 0; i < kFrames; ++i) {
        ASSERT_TRUE(channel.send(i, frameOf(i)));
        const bool now = channel.receive(i, buffer) == 0;
        lost += now;
        runs += now && !before;
        before = now;
      }
      // Runs, not frames, are independent: 5 sigma of their number.
      EXPECT_NEAR(static_cast<double>(lost) / runs, burst, 5 * burst / std::sqrt(runs)) << loss;
      EXPECT_NEAR(static_cast<double>(lost) / kFrames, loss, 5 * loss / std::sqrt(runs)) << burst;
    }
}

TEST(Channel, IndependentLossesComeInTheRunsOfChance) {
  ChannelConfig config = clearWater();
  config.loss = 0.5;
  config.mean_burst = 2;  // of independent losses: 1 / (1 - 0.5)
  AcousticChannel channel(config);
  Buffer buffer;
  int lost_after_lost = 0, lost = 0;
  bool before = false;
  for (int i = 0; i < 20000; ++i) {
    (void)channel.send(i, frameOf(i));
    const bool now = channel.receive(i, buffer) == 0;
    lost += before;
    lost_after_lost += before && now;
    before = now;
  }
  EXPECT_NEAR(static_cast<double>(lost_after_lost) / lost, 0.5, 0.025);
}

TEST(Channel, BurstsThatCannotBeAreRefused) {
  ChannelConfig config = clearWater();
  config.mean_burst = 0.5;
  EXPECT_THROW(AcousticChannel{config}, std::invalid_argument);
  config.loss = 0.9;
  config.mean_burst = 5;  // the good runs would be shorter than a frame
  EXPECT_THROW(AcousticChannel{config}, std::invalid_argument);
  config.mean_burst = 10;
  EXPECT_NO_THROW(AcousticChannel{config});
}

TEST(Channel, AHalfDuplexModemReceivesNothingWhileItTransmits) {
  ChannelConfig config = clearWater();
  config.rate_bps = 320;  // 40 bytes a second
  config.delay_s = 2.0;
  ChannelPair pair(config, config, true);
  Buffer buffer;
  ASSERT_TRUE(pair.vehicle().send(frameOf(1)));  // at the ship from 2 s to 3 s
  pair.advance(2.5);
  ASSERT_TRUE(
      pair.ship().send(frameOf(2)));  // spoken from 2.5 s to 3.5 s, at the vehicle from 4.5 s to 5.5 s
  pair.advance(3.5);
  EXPECT_EQ(pair.ship().receive(buffer), 0U);
  EXPECT_EQ(pair.uplink().counters().collided, 1U);
  pair.advance(5.5);
  ASSERT_EQ(pair.vehicle().receive(buffer), 40U);  // the vehicle was silent
  EXPECT_EQ(numberOf(buffer), 2);
  // One after the other: both arrive.
  ASSERT_TRUE(pair.vehicle().send(frameOf(3)));
  pair.advance(8.5);
  ASSERT_EQ(pair.ship().receive(buffer), 40U);
  ASSERT_TRUE(pair.ship().send(frameOf(4)));
  pair.advance(11.5);
  ASSERT_EQ(pair.vehicle().receive(buffer), 40U);
  EXPECT_EQ(pair.downlink().counters().collided, 0U);
}

TEST(Channel, SimultaneousFramesOfHalfDuplexModemsCollide) {
  ChannelConfig config = clearWater();
  config.rate_bps = 320;
  config.delay_s = 0.2;
  for (const bool half_duplex : {false, true}) {
    ChannelPair pair(config, config, half_duplex);
    Buffer buffer;
    ASSERT_TRUE(pair.vehicle().send(frameOf(1)));
    ASSERT_TRUE(pair.ship().send(frameOf(2)));
    pair.advance(5);
    EXPECT_EQ(pair.vehicle().receive(buffer), half_duplex ? 0U : 40U);
    EXPECT_EQ(pair.ship().receive(buffer), half_duplex ? 0U : 40U);
  }
}

TEST(Channel, TheSameSeedGivesTheSameFate) {
  const auto fate = [](std::uint64_t seed) {
    AcousticChannel channel({.loss = 0.5, .seed = seed});
    std::vector<int> arrived;
    Buffer buffer;
    for (int i = 0; i < 60; ++i) (void)channel.send(i, frameOf(i));
    while (channel.receive(1e6, buffer) > 0) arrived.push_back(numberOf(buffer));
    return arrived;
  };
  EXPECT_EQ(fate(1), fate(1));
  EXPECT_NE(fate(1), fate(2));
}

TEST(Channel, APairJoinsTwoPortsInBothDirections) {
  ChannelConfig config = clearWater();
  config.delay_s = 1.0;
  ChannelPair pair(config, config);
  Buffer buffer;
  ASSERT_TRUE(pair.vehicle().send(frameOf(1)));
  ASSERT_TRUE(pair.ship().send(frameOf(2)));
  EXPECT_EQ(pair.ship().receive(buffer), 0U);
  pair.advance(1.0);
  ASSERT_EQ(pair.ship().receive(buffer), 40U);
  EXPECT_EQ(numberOf(buffer), 1);
  ASSERT_EQ(pair.vehicle().receive(buffer), 40U);
  EXPECT_EQ(numberOf(buffer), 2);
  EXPECT_EQ(pair.uplink().counters().delivered, 1U);
}

TEST(Channel, ProbabilitiesOutOfRangeAreRefused) {
  ChannelConfig config{.loss = 1.5};
  EXPECT_THROW(AcousticChannel{config}, std::invalid_argument);
  config.loss = std::nan("");
  EXPECT_THROW(AcousticChannel{config}, std::invalid_argument);
}

TEST(Channel, TheRelayCarriesDatagramsInBothDirectionsAndEndsWhenIdle) {
  // A free port for the relay: one that the system gives and takes back.
  const std::uint16_t relay_port = io::UdpFramePort("127.0.0.1", 0, "127.0.0.1", 0).boundPort();
  io::UdpFramePort ship("127.0.0.1", 0, "127.0.0.1", relay_port);
  ChannelRelayOptions options;
  options.listen_port = relay_port;
  options.to_host = "127.0.0.1";
  options.to_port = ship.boundPort();
  options.idle_exit_s = 0.5;
  options.channel = options.down = clearWater();
  int exit_code = -1;
  std::thread relay([&] { exit_code = runChannelRelay(options); });
  io::UdpFramePort vehicle("127.0.0.1", 0, "127.0.0.1", relay_port);
  Buffer buffer;
  std::size_t size = 0;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (size == 0 && std::chrono::steady_clock::now() < deadline) {  // until the relay listens
    (void)vehicle.send(frameOf(9));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    size = ship.receive(buffer);
  }
  EXPECT_EQ(size, 40U);
  EXPECT_EQ(numberOf(buffer), 9);
  EXPECT_TRUE(ship.send(frameOf(33)));
  relay.join();
  ASSERT_EQ(vehicle.receive(buffer), 40U);
  EXPECT_EQ(numberOf(buffer), 33);
  EXPECT_EQ(exit_code, 0);
}

}  // namespace
}  // namespace fathom::sim

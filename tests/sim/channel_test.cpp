#include "sim/link/channel.hpp"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <thread>

#include "firmware_if/modem_ports.hpp"
#include "sim/link/channel_relay.hpp"

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

TEST(Channel, TheSameSeedGivesTheSameFate) {
  const auto fate = [](std::uint64_t seed) {
    ChannelConfig config;
    config.loss = 0.5;
    config.seed = seed;
    AcousticChannel channel(config);
    std::vector<int> arrived;
    Buffer buffer;
    for (int i = 0; i < 60; ++i) (void)channel.send(i, frameOf(i));
    while (channel.receive(1e6, buffer) > 0) arrived.push_back(numberOf(buffer));
    return arrived;
  };
  EXPECT_EQ(fate(1), fate(1));
  EXPECT_NE(fate(1), fate(2));
}

TEST(Channel, APairJoinsTwoPortsBothWays) {
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
  ChannelConfig config;
  config.loss = 1.5;
  EXPECT_THROW(AcousticChannel{config}, std::invalid_argument);
  config.loss = std::nan("");
  EXPECT_THROW(AcousticChannel{config}, std::invalid_argument);
}

TEST(Channel, TheRelayCarriesDatagramsBothWaysAndEndsWhenIdle) {
  // A free port for the relay: one that the system gives and takes back.
  const std::uint16_t relay_port = io::UdpFramePort("127.0.0.1", 0, "127.0.0.1", 0).boundPort();
  io::UdpFramePort ship("127.0.0.1", 0, "127.0.0.1", relay_port);
  ChannelRelayOptions options;
  options.listen_port = relay_port;
  options.to_host = "127.0.0.1";
  options.to_port = ship.boundPort();
  options.idle_exit_s = 0.5;
  options.channel = clearWater();
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

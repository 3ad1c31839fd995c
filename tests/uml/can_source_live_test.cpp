// CanSource on a real CAN interface; runs inside the user-mode Linux (`uml_run --can`).
#include <gmock/gmock.h>
#include <linux/can/error.h>
#include <time.h>

#include "tests/support/heap_counter.hpp"
#include "tests/uml/live_bus.hpp"

namespace fathom::uml {
namespace {

using io::CanSource;

constexpr std::uint8_t kCompass = 35, kGauge = 40, kReceiver = 50;
class CanOnARealInterface : public ::testing::Test {
 protected:
  void SetUp() override {
    if (::if_nametoindex("vcan0") == 0) GTEST_SKIP() << "no vcan0: run by uml_run --can";
    config_.interface = "vcan0";
    config_.samples.latitude = 0.6;
  }
  // Pascals above the surface's pressure.
  static bool sendPressure(BusPeer& peer, double above_pa) {
    const auto raw = static_cast<std::uint32_t>((101325 + above_pa) * 10);
    return peer.send(130314, kGauge,
                     {0xFF, 0, 1, static_cast<std::uint8_t>(raw), static_cast<std::uint8_t>(raw >> 8),
                      static_cast<std::uint8_t>(raw >> 16), static_cast<std::uint8_t>(raw >> 24), 0xFF});
  }
  // Polls until the source is open or not, at most `seconds`.
  bool pollUntilOpen(CanSource& source, ReceivedSamples& received, bool open, int seconds) {
    const std::int64_t end = clock_.monotonicNs() + seconds * kSecond_ns;
    while (clock_.monotonicNs() < end)
      if (source.poll(50, received) == open) return true;
    return false;
  }
  // A source loses its interface by one command and has it again by the other.
  void expectBackAfter(const char* away, const char* back) {
    CanSource source(config_, clock_);
    ReceivedSamples received;
    shell(away);
    EXPECT_TRUE(pollUntilOpen(source, received, false, 2));
    EXPECT_EQ(source.health().disconnects, 1U);
    EXPECT_FALSE(source.health().open);
    shell(back);
    EXPECT_TRUE(pollUntilOpen(source, received, true, 3));
    BusPeer peer("vcan0");
    sendPressure(peer, 0);
    EXPECT_TRUE(source.poll(100, received));
    EXPECT_EQ(received.of<DepthSample>().size(), 1U);
    EXPECT_EQ(source.health().disconnects, 1U);
  }
  io::CanConfig config_;
  VehicleClock clock_;
};

TEST_F(CanOnARealInterface, SamplesCarryTheKernelsTimeOfReceptionInVehicleTime) {
  CanSource source(config_, clock_);
  BusPeer peer("vcan0");
  ReceivedSamples received;
  const std::int64_t before = clock_.utcNs();
  ASSERT_TRUE(sendPressure(peer, 200'000));
  const std::int64_t after = clock_.utcNs();
  // What waits in the queue gets no younger by being read late.
  ::usleep(100'000);
  EXPECT_TRUE(source.poll(0, received));
  const auto depths = received.of<DepthSample>();
  ASSERT_EQ(depths.size(), 1U);
  EXPECT_NEAR(depths[0].depth, 19.8, 0.2);
  EXPECT_GE(depths[0].utc_ns, before - 1'000'000);
  EXPECT_LE(depths[0].utc_ns, after + 1'000'000);
  EXPECT_EQ(received.last_arrival_ns, depths[0].utc_ns);
}

TEST_F(CanOnARealInterface, AStepOfTheSystemsClockMovesNoSample) {
  CanSource source(config_, clock_);
  BusPeer peer("vcan0");
  ReceivedSamples received;
  timespec now = {};
  const auto step = [&](int seconds) {
    ::clock_gettime(CLOCK_REALTIME, &now);
    now.tv_sec += seconds;
    ASSERT_EQ(::clock_settime(CLOCK_REALTIME, &now), 0);
  };
  static_cast<void>(source.poll(0, received));
  const std::int64_t before = clock_.utcNs();
  for (const int seconds : {3600, -7200, 3600}) {
    sendPressure(peer, 100'000);
    ::usleep(20'000);
    step(seconds);
    sendPressure(peer, 100'000);
    EXPECT_TRUE(source.poll(0, received));
  }
  const std::int64_t after = clock_.utcNs();
  const auto depths = received.of<DepthSample>();
  ASSERT_EQ(depths.size(), 6U);
  std::int64_t last = before;
  for (const DepthSample& sample : depths) {
    EXPECT_GE(sample.utc_ns, last);
    last = sample.utc_ns;
  }
  EXPECT_LE(last, after);
  EXPECT_EQ(counter(source, "clock_steps"), 3U);
}

TEST_F(CanOnARealInterface, TheKernelKeepsOtherParameterGroupsAway) {
  CanSource source(config_, clock_);
  BusPeer peer("vcan0");
  ReceivedSamples received;
  for (const std::uint32_t pgn : {127245U, 127489U, 130306U, 126992U})
    peer.send(pgn, 7, {1, 2, 3, 4, 5, 6, 7, 8});
  peer.send(0x123, {1, 2});                                     // 11 bits
  peer.send((127250U << 8) | CAN_EFF_FLAG | CAN_RTR_FLAG, {});  // remote
  sendPressure(peer, 0);
  EXPECT_TRUE(source.poll(100, received));
  EXPECT_EQ(counter(source, "frames"), 1U);
  EXPECT_EQ(received.raw_frames, 1U);
}

TEST_F(CanOnARealInterface, HeadingAndAttitudeFromCansendMakeOneSample) {
  // To start three programs may take a busy machine long.
  config_.samples.attitude_gap_s = 30;
  CanSource source(config_, clock_);
  ReceivedSamples received;
  // Roll 0.1, pitch -0.05 rad; heading 2 rad, deviation 0.01 rad, magnetic; roll 0.12 rad.
  shell(
      "cansend vcan0 09F11923#FFFF7F0CFEE803FF && cansend vcan0 09F11223#FF204E6400FF7FFD && "
      "cansend vcan0 09F11923#FFFF7F0CFEB004FF");
  EXPECT_TRUE(source.poll(100, received));
  const auto attitudes = received.of<AttitudeSample>();
  ASSERT_EQ(attitudes.size(), 1U);
  EXPECT_NEAR(attitudes[0].heading, 2.01, 1e-9);
  EXPECT_TRUE(attitudes[0].magnetic);
  EXPECT_NEAR(attitudes[0].pitch, -0.05, 1e-9);
  EXPECT_GT(attitudes[0].roll, 0.1);
  EXPECT_LT(attitudes[0].roll, 0.12);
}

TEST_F(CanOnARealInterface, AFastPacketFromCanplayerIsAFix) {
  CanSource source(config_, clock_);
  ReceivedSamples received;
  // 51.2 degrees north, -6.5 east, method GNSS fix, HDOP 1.2 (129029, 43 bytes).
  const std::vector<std::uint8_t> payload = [] {
    std::vector<std::uint8_t> p(43, 0xFF);
    const auto put = [&p](std::size_t at, std::int64_t value, std::size_t size) {
      for (std::size_t i = 0; i < size; ++i) p[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
    };
    put(7, 512'000'000'000'000'000, 8);
    put(15, -65'000'000'000'000'000, 8);
    p[31] = 0x10;
    put(34, 120, 2);
    return p;
  }();
  BusPeer peer("vcan0");
  std::size_t at = 0;
  for (std::uint8_t index = 0; at < payload.size(); ++index) {
    std::vector<std::uint8_t> bytes = {static_cast<std::uint8_t>(0x40 | index)};
    if (index == 0) bytes.push_back(static_cast<std::uint8_t>(payload.size()));
    while (bytes.size() < 8) bytes.push_back(at < payload.size() ? payload[at] : std::uint8_t{0xFF}), ++at;
    ASSERT_TRUE(peer.send(129029, kReceiver, bytes));
  }
  EXPECT_TRUE(source.poll(100, received));
  const auto fixes = received.of<GpsFix>();
  ASSERT_EQ(fixes.size(), 1U);
  EXPECT_NEAR(fixes[0].latitude * 57.29577951308232, 51.2, 1e-12);
  EXPECT_NEAR(fixes[0].longitude * 57.29577951308232, -6.5, 1e-12);
  EXPECT_NEAR(fixes[0].sigma_horizontal, 6.0, 1e-9);
}

TEST_F(CanOnARealInterface, AnInterfaceThatGoesDownComesBackByItself) {
  expectBackAfter("ip link set vcan0 down", "ip link set vcan0 up");
}

TEST_F(CanOnARealInterface, ARecreatedInterfaceIsReopened) {
  expectBackAfter("ip link del vcan0", "ip link add vcan0 type vcan && ip link set vcan0 up");
}

TEST_F(CanOnARealInterface, ASourceFindsAnInterfaceCreatedLater) {
  config_.interface = "vcan7";
  CanSource source(config_, clock_);
  ReceivedSamples received;
  EXPECT_FALSE(source.poll(20, received));
  shell("ip link add vcan7 type vcan && ip link set vcan7 up");
  EXPECT_TRUE(pollUntilOpen(source, received, true, 3));
  EXPECT_EQ(source.health().disconnects, 0U);
  shell("ip link del vcan7");
}

TEST_F(CanOnARealInterface, ErrorFramesAreCountedByKindAndBusOffIsReported) {
  CanSource source(config_, clock_);
  BusPeer peer("vcan0");
  ReceivedSamples received;
  const auto error = [&](std::uint32_t classes, std::uint8_t controller) {
    ASSERT_TRUE(peer.send(classes | CAN_ERR_FLAG, {0, controller, 0, 0, 0, 0, 0, 0}));
  };
  error(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING);
  error(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE);
  error(CAN_ERR_ACK | CAN_ERR_BUSERROR, 0);
  error(CAN_ERR_BUSOFF, 0);
  EXPECT_TRUE(source.poll(100, received));
  EXPECT_EQ(counter(source, "error_frames"), 4U);
  EXPECT_EQ(counter(source, "error_warning"), 1U);
  EXPECT_EQ(counter(source, "error_passive"), 1U);
  EXPECT_EQ(counter(source, "no_acknowledge"), 1U);
  EXPECT_EQ(counter(source, "bus_error"), 1U);
  EXPECT_EQ(counter(source, "bus_off"), 1U);
  EXPECT_EQ(counter(source, "bus_is_off"), 1U);
  EXPECT_EQ(received.raw_frames, 4U);
  error(CAN_ERR_RESTARTED, 0);
  EXPECT_TRUE(source.poll(100, received));
  EXPECT_EQ(counter(source, "bus_is_off"), 0U);
  EXPECT_EQ(counter(source, "restarted"), 1U);
}

TEST_F(CanOnARealInterface, FramesThatTheKernelDropsAreCounted) {
  CanSource source(config_, clock_);
  BusPeer peer("vcan0");
  ReceivedSamples received;
  constexpr std::uint64_t kSent = 8'000;  // several times what the socket's buffer holds
  for (std::uint64_t i = 0; i < kSent; ++i) ASSERT_TRUE(sendPressure(peer, 0));
  for (int i = 0; i < 40; ++i) static_cast<void>(source.poll(0, received));
  // The count comes with the next frame that gets through.
  sendPressure(peer, 0);
  EXPECT_TRUE(source.poll(100, received));
  EXPECT_GT(counter(source, "kernel_drops"), 0U);
  EXPECT_EQ(counter(source, "frames") + counter(source, "kernel_drops"), kSent + 1);
}

TEST_F(CanOnARealInterface, PollingTakesNoMemory) {
  CanSource source(config_, clock_);
  BusPeer peer("vcan0");
  ReceivedSamples received;
  io::DeviceHealth health = source.health();
  const std::vector<std::uint8_t> tilt = {0xFF, 0xFF, 0x7F, 0x0C, 0xFE, 0xE8, 0x03, 0xFF},
                                  heading = {0xFF, 0x20, 0x4E, 0x64, 0x00, 0xFF, 0x7F, 0xFD}, error(8, 0);
  std::uint64_t heap_calls = 0;
  const auto poll = [&] {
    const rt::ThreadCost before = rt::threadCost();
    static_cast<void>(source.poll(1, received));
    health = source.health();
    heap_calls += (rt::threadCost() - before).heap_calls;
  };
  for (int i = 0; i < 200; ++i) {
    peer.send(127257, kCompass, tilt);
    peer.send(127250, kCompass, heading);
    peer.send(CAN_ERR_BUSERROR | CAN_ERR_FLAG, error);
    poll();
  }
  // Closed, and open again.
  shell("ip link set vcan0 down");
  poll();
  shell("ip link set vcan0 up");
  while (!source.poll(50, received)) continue;
  poll();
  EXPECT_EQ(heap_calls, 0U);
  // The machine's clock is coarse: headings that came at one time are one.
  EXPECT_GT(received.of<AttitudeSample>().size(), 150U);
}

}  // namespace
}  // namespace fathom::uml

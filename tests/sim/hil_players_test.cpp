#include <fcntl.h>
#include <gmock/gmock.h>
#include <lcm/lcm.h>
#include <unistd.h>

#include <thread>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"
#include "firmware_if/devices/modem/modem_ports.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "sim/hil/players/dvl_player.hpp"
#include "sim/hil/players/lcm_player.hpp"
#include "sim/hil/players/modem_player.hpp"
#include "sim/hil/players/pseudo_terminal.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/packet_log.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/missions.hpp"

namespace fathom::sim {
namespace {

class HilPlayers : public testing::Test {
 protected:
  void SetUp() override {
    writeTenSecondMission(folder_.path() / "mission");
    ScheduleOptions options{.start_utc_ns = kMissionNs + 3600 * kSecond_ns};
    clock_.advance(options.start_utc_ns - kSecond_ns);
    schedule_ = makeSchedule(folder_.path() / "mission", options);
  }
  [[nodiscard]] double missionNow() {
    return schedule_.missionSeconds(SimulatedVehicleClock(clock_).utcNs());
  }

  test::TemporaryFolder folder_;
  test::ManualClock clock_;  // nothing waits: ten seconds pass at once
  MissionSchedule schedule_;
};

TEST_F(HilPlayers, EveryEnsembleEndsWhenTheMissionsRecorderHadItAtTheLinesPace) {
  SimulatedVehicleClock clock(clock_);
  io::Pd0Decoder decoder;
  std::vector<std::pair<std::int64_t, DvlSample>> received;
  std::int64_t last_ns = 0;
  double fastest = 0;  // bytes a second
  DvlPlayer player(schedule_, {}, clock, [&](std::span<const std::uint8_t> bytes) {
    const std::int64_t now_ns = clock.utcNs();
    if (last_ns != 0)
      fastest =
          std::max(fastest, 1e9 * static_cast<double>(bytes.size()) / static_cast<double>(now_ns - last_ns));
    last_ns = now_ns;
    decoder.feed(bytes,
                 [&](const io::Pd0Ensemble& e) { received.emplace_back(now_ns, *io::toDvlSample(e)); });
  });
  player.run(kNeverStop);
  EXPECT_EQ(player.counters().ensembles, 50U);
  ASSERT_EQ(received.size(), 50U);
  std::size_t i = 0;
  for (const ScheduledSample& s : schedule_.samples) {
    const auto* sent = std::get_if<DvlSample>(&s.sample);
    if (sent == nullptr) continue;
    EXPECT_NEAR(static_cast<double>(received[i].first - s.due_utc_ns), 0, 1e5);
    EXPECT_EQ(received[i].second.utc_ns, sent->utc_ns);
    EXPECT_LE((*received[i].second.velocity - *sent->velocity).norm(), 1e-3);
    ++i;
  }
  EXPECT_LE(fastest, DvlPlayer::kBaud / 10.0 * 1.01);
}

TEST_F(HilPlayers, GarbageAndSilenceOfTheDvlAreCountedAsTheReceiverCountsThem) {
  const FaultScript script = parseFaultScript(
      "[[fault]]\nkind = \"dvl_garbage\"\nat_s = 2\nfor_s = 3\nevery = 2\nnoise_bytes = 50\n"
      "[[fault]]\nkind = \"dvl_silence\"\nat_s = 6\nfor_s = 1\n",
      "faults.toml");
  SimulatedVehicleClock clock(clock_);
  io::Pd0Decoder decoder;
  std::uint64_t received = 0;
  DvlPlayer player(schedule_, script, clock, [&](std::span<const std::uint8_t> bytes) {
    decoder.feed(bytes, [&](const io::Pd0Ensemble&) { ++received; });
  });
  player.run(kNeverStop);
  decoder.drain([&](const io::Pd0Ensemble&) { ++received; });
  const auto expected = script.expectedCounts(schedule_.playedTimes());
  EXPECT_EQ(player.counters().damaged, expected[static_cast<std::size_t>(FaultKind::kDvlGarbage)]);
  EXPECT_EQ(player.counters().withheld, expected[static_cast<std::size_t>(FaultKind::kDvlSilence)]);
  EXPECT_EQ(player.counters().damaged, 8U);
  EXPECT_EQ(player.counters().withheld, 5U);
  EXPECT_EQ(decoder.counts().bad_checksum, player.counters().damaged);
  EXPECT_EQ(received + player.counters().damaged + player.counters().withheld, 50U);
}

TEST_F(HilPlayers, TheTerminalCarriesBytesInBothDirectionsUnderAStableNameAndDropsUnreadOnes) {
  PseudoTerminal cable(folder_.path() / "dvl");
  const int port = ::open((folder_.path() / "dvl").c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
  ASSERT_GE(port, 0);
  std::array<std::uint8_t, 256> all{};
  for (std::size_t i = 0; i < all.size(); ++i)
    all[i] = static_cast<std::uint8_t>(i);  // control characters too
  EXPECT_TRUE(cable.write(all));
  std::array<std::uint8_t, 512> got{};
  ASSERT_EQ(::read(port, got.data(), got.size()), 256);
  EXPECT_TRUE(std::equal(all.begin(), all.end(), got.begin()));
  ASSERT_EQ(::write(port, all.data(), all.size()), 256);
  ASSERT_EQ(cable.read(got), 256U);
  EXPECT_TRUE(std::equal(all.begin(), all.end(), got.begin()));
  ::close(port);

  // A cable without a reader never blocks.
  for (int i = 0; i < 100; ++i) (void)cable.write(all);
  EXPECT_GT(cable.unreadBytes(), PseudoTerminal::kUnreadBytes);
  EXPECT_THROW(PseudoTerminal(folder_.path() / "absent" / "dvl"), InputError);
}

// What a vehicle's program does: sends frames, the turn with every second, and listens.
TEST_F(HilPlayers, TheShipReceivesTheVehicleAndItsFixesArriveOverTheModem) {
  constexpr telemetry::LinkIdentity kIdentity{3, 17};
  SimulatedShipOptions water;
  water.loss = water.duplicate = water.reorder = water.corrupt = 0;
  water.delay_s = 0.05;
  water.rate_bps = 9600;
  water.half_duplex = false;
  rt::RealClock real;
  SimulatedVehicleClock clock(real);
  // The fix is due now.
  for (ScheduledSample& s : schedule_.samples)
    if (auto* fix = std::get_if<UsblFix>(&s.sample)) s.due_utc_ns = fix->utc_ns = clock.utcNs();
  std::atomic<bool> stop{false};
  ModemPlayer player(schedule_, {}, clock, folder_.path() / "heard.bin", water, folder_.path() / "modem");
  std::thread thread([&] { player.run(stop); });
  io::SerialFramePort vehicle(folder_.path() / "modem", 9600);
  telemetry::DownlinkReceiver ear(kIdentity, std::nullopt, 0);
  std::optional<telemetry::UsblFixMessage> fix;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer{};
  std::uint16_t sent = 0;
  for (int i = 0; i < 300 && !fix; ++i) {
    if (i % 20 == 0) {
      const std::size_t size = telemetry::encodeFrame({.identity = kIdentity,
                                                       .version = sent,
                                                       .type = telemetry::MessageType::kTrack,
                                                       .turn = sent % 2 == 1},
                                                      std::vector<std::uint8_t>(22, 5), buffer);
      if (vehicle.send(std::span(buffer).first(size))) ++sent;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    while (const std::size_t size = vehicle.receive(buffer)) {
      const auto content = ear.accept(clock.utcNs(), std::span(buffer).first(size)).content;
      if (content.fix) fix = content.fix;
    }
  }
  stop = true;
  thread.join();
  ASSERT_TRUE(fix.has_value());
  EXPECT_NEAR(fix->latitude, -radiansToDegrees(0.4), 1e-7);
  EXPECT_EQ(player.counters().from_vehicle, sent);
  telemetry::PacketLogReader received(folder_.path() / "heard.bin");
  EXPECT_TRUE(received.next().has_value());
}

TEST_F(HilPlayers, ASilentModemLosesFramesInBothDirectionsAndCountsThem) {
  const FaultScript script =
      parseFaultScript("[[fault]]\nkind = \"modem_silence\"\nat_s = 0\nfor_s = 1000\n", "faults.toml");
  rt::RealClock real;
  SimulatedVehicleClock clock(real);
  schedule_.start_utc_ns = clock.utcNs() - kSecond_ns;
  std::atomic<bool> stop{false};
  ModemPlayer player(schedule_, script, clock, folder_.path() / "heard.bin", {}, std::uint16_t{0});
  std::thread thread([&] { player.run(stop); });
  io::UdpFramePort vehicle("127.0.0.1", 0, "127.0.0.1", player.udpPort());
  EXPECT_TRUE(vehicle.send(std::vector<std::uint8_t>(32, 1)));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  stop = true;
  thread.join();
  EXPECT_EQ(player.counters().silenced, 1U);
  EXPECT_EQ(player.counters().from_vehicle, 0U);
}

TEST_F(HilPlayers, WhatCompassAndDepthSayIsOnLcmExceptWhileTheBusIsOff) {
  const FaultScript script =
      parseFaultScript("[[fault]]\nkind = \"can_bus_off\"\nat_s = 4\nfor_s = 1\n", "faults.toml");
  SimulatedVehicleClock clock(clock_);
  // Within one process: LCM's own in-memory provider is of one instance; a file holds what was published.
  const std::filesystem::path file = folder_.path() / "published.lcmlog";
  {
    LcmPlayer player(schedule_, script, clock, "file://" + file.string() + "?mode=w");
    player.run(kNeverStop);
    EXPECT_EQ(player.counters().messages, 90U);
    EXPECT_EQ(player.counters().withheld, 10U);
    EXPECT_EQ(player.counters().refused, 0U);
  }
  lcm_eventlog_t* log = ::lcm_eventlog_create(file.c_str(), "r");
  ASSERT_NE(log, nullptr);
  int attitudes = 0;
  while (lcm_eventlog_event_t* event = ::lcm_eventlog_read_next_event(log)) {
    const auto decoded = io::decodeSample(event->channel, {static_cast<const std::uint8_t*>(event->data),
                                                           static_cast<std::size_t>(event->datalen)});
    ASSERT_TRUE(decoded.has_value());
    const auto* attitude = std::get_if<AttitudeSample>(&decoded->sample);
    ASSERT_NE(attitude, nullptr) << "DVL and USBL use other interfaces";
    EXPECT_EQ(attitude->utc_ns + 5 * kMillisecond_ns, decoded->arrival_utc_ns);
    ++attitudes;
    ::lcm_eventlog_free_event(event);
  }
  ::lcm_eventlog_destroy(log);
  EXPECT_EQ(attitudes, 90);
  EXPECT_THROW(LcmPlayer(schedule_, script, clock, "nonsense://"), InputError);
}

}  // namespace
}  // namespace fathom::sim

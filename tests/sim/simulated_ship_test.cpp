#include "sim/link/simulated_ship.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "realtime/base/input_error.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/packet_log.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::sim {
namespace {

constexpr telemetry::LinkIdentity kIdentity{3, 17};
constexpr std::int64_t kStart_ns = 1'790'000'000 * kSecond_ns;
using Bytes = std::vector<std::uint8_t>;

Bytes uplink(int sequence, bool turn) {
  telemetry::FrameHeader header{.identity = kIdentity,
                                .version = static_cast<std::uint16_t>(sequence),
                                .type = telemetry::MessageType::kTrack,
                                .turn = turn};
  Bytes frame(telemetry::kMaxFrameBytes);
  const Bytes payload(22, 5);
  frame.resize(telemetry::encodeFrame(header, payload, frame));
  return frame;
}

std::vector<telemetry::Packet> packetsIn(const std::filesystem::path& file) {
  telemetry::PacketLogReader reader(file);
  std::vector<telemetry::Packet> packets;
  while (auto packet = reader.next()) packets.push_back(std::move(*packet));
  return packets;
}

// A vehicle that sends a frame every two seconds and listens after every tenth.
struct Dive {
  std::vector<telemetry::Packet> received;
  std::vector<telemetry::Acknowledgement> acknowledgements;
  std::vector<telemetry::UsblFixMessage> fixes;  // as the vehicle got them
  SimulatedShip::Summary summary;
};
// With `fixes`, the ship measures one every seven seconds.
Dive dive(const SimulatedShipOptions& options, int frames, bool fixes = false) {
  const test::TemporaryFolder folder;
  Dive result;
  SimulatedShip ship(folder.path() / "heard.bin", options);
  telemetry::DownlinkReceiver vehicle(kIdentity, options.key, kStart_ns - kSecond_ns);
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer{};
  int sequence = 0;
  for (int tick = 0; sequence < frames; ++tick) {
    const std::int64_t now_ns = kStart_ns + tick * kSecond_ns;
    ship.advance(now_ns);
    if (fixes && tick % 7 == 0) ship.addFix({now_ns, -23.0 + 1e-5 * tick, 151.0, 12.0, 1.5});
    while (const std::size_t size = ship.modem().receive(buffer)) {
      const telemetry::DownlinkContent content =
          vehicle.accept(now_ns, std::span(buffer).first(size)).content;
      if (content.acknowledgement) result.acknowledgements.push_back(*content.acknowledgement);
      if (content.fix) result.fixes.push_back(*content.fix);
    }
    constexpr int kPeriod = 30;  // [s]: ten frames, then ten seconds of silence
    if (tick % kPeriod >= 20 || tick % 2 != 0) continue;
    EXPECT_TRUE(ship.modem().send(uplink(sequence, tick % kPeriod == 18)));
    ++sequence;
  }
  ship.advance(kStart_ns + 1'000'000 * kSecond_ns);
  ship.finish();
  result.received = packetsIn(folder.path() / "heard.bin");
  result.summary = ship.summary();
  return result;
}

SimulatedShipOptions clear() {
  SimulatedShipOptions options;
  options.loss = 0;
  return options;
}

TEST(SimulatedShip, ReceivesAfterTransmissionAndDelayAndAnswersEveryTurn) {
  const Dive d = dive(clear(), 100);
  EXPECT_EQ(d.summary.sent, 100u);
  EXPECT_GE(d.received.size(), 97u);  // a few are damaged beyond their CRC, but received
  // 32 bytes at 300 bit/s, and a second of travel.
  EXPECT_NEAR(static_cast<double>(d.received.front().utc_ns - kStart_ns), (32 * 8 / 300.0 + 1) * 1e9, 1e6);
  for (std::size_t i = 1; i < d.received.size(); ++i)
    EXPECT_GE(d.received[i].utc_ns, d.received[i - 1].utc_ns);
  EXPECT_GE(d.summary.answers, 8u);
  EXPECT_EQ(d.summary.collided, 0u);
  ASSERT_GE(d.acknowledgements.size(), 8u);
  EXPECT_EQ(d.acknowledgements.front().newest, 9);
}

TEST(SimulatedShip, AcknowledgesExactlyTheReceivedFrames) {
  SimulatedShipOptions options = clear();
  options.loss = 0.3;
  options.mean_burst = 5;
  options.seed = 7;
  const Dive d = dive(options, 300);
  EXPECT_NEAR(d.summary.loss, 0.3, 0.12);
  ASSERT_FALSE(d.acknowledgements.empty());
  std::vector<bool> received(300);
  for (const telemetry::Packet& p : d.received) {
    const auto frame = telemetry::decodeFrame(p.bytes);
    if (frame.verdict == telemetry::FrameVerdict::kAccepted) received[frame.header.sequence()] = true;
  }
  int lost = 0, covered = 0;
  const telemetry::Acknowledgement& last = d.acknowledgements.back();
  for (int s = 0; s <= last.newest; ++s) {
    const auto word = last.received(static_cast<std::uint16_t>(s));
    if (!word) continue;
    ++covered;
    lost += !*word;
    EXPECT_EQ(*word, received[static_cast<std::size_t>(s)]) << s;
  }
  EXPECT_GE(covered, 30);  // at least the frames of three turns
  EXPECT_GT(lost, 0);
}

TEST(SimulatedShip, EveryFixIsSaidOnceInOrderAndReachesTheVehicleWithItsOwnTime) {
  SimulatedShipOptions options = clear();
  options.duplicate = options.reorder = options.corrupt = 0;
  options.frame_bytes = 64;                // room for an acknowledgement beside the fix
  const Dive d = dive(options, 80, true);  // seven turns or eight of the ship
  ASSERT_GE(d.fixes.size(), 5u);
  EXPECT_EQ(d.fixes.size(), d.summary.fixes_sent);
  for (std::size_t i = 0; i < d.fixes.size(); ++i) {
    const auto tick = static_cast<double>(7 * i);
    EXPECT_NEAR(static_cast<double>(d.fixes[i].utc_ns - kStart_ns), 1e9 * tick, 1e7);
    EXPECT_NEAR(d.fixes[i].latitude, -23.0 + 1e-5 * tick, 1e-7);
  }
}

TEST(SimulatedShip, TheSameSeedIsTheSameDive) {
  SimulatedShipOptions options = clear();
  options.loss = 0.4;
  const Dive a = dive(options, 60), b = dive(options, 60);
  ASSERT_EQ(a.received.size(), b.received.size());
  for (std::size_t i = 0; i < a.received.size(); ++i) EXPECT_EQ(a.received[i].bytes, b.received[i].bytes);
}

TEST(SimulatedShip, AComputerThatIsOffReceivesNothingAndResumesAfterwards) {
  SimulatedShipOptions options = clear();
  options.off_from_s = 60;
  options.off_to_s = 360;
  const Dive d = dive(options, 200);
  int during = 0, after = 0;
  for (const telemetry::Packet& p : d.received) {
    const double t = static_cast<double>(p.utc_ns - kStart_ns) / 1e9;
    during += t >= 60 && t < 360;
    after += t >= 360;
  }
  EXPECT_EQ(during, 0);
  EXPECT_GT(after, 70);
  // It begins with nothing in its memory, and says so; then it speaks of the latest frames too.
  ASSERT_GT(d.acknowledgements.size(), 5U);
  const auto last = std::span(d.acknowledgements).last(5);
  EXPECT_TRUE(std::any_of(last.begin(), last.end(), [](const telemetry::Acknowledgement& a) {
    return a.received(static_cast<std::uint16_t>(a.newest - 1)) == true;
  }));
  EXPECT_TRUE(std::any_of(last.begin(), last.end(), [](const telemetry::Acknowledgement& a) {
    return a.lacking == telemetry::Acknowledgement::kAll;
  }));
}

TEST(SimulatedShip, AWaterThatCannotBeIsRefused) {
  const test::TemporaryFolder folder;
  SimulatedShipOptions options;
  options.loss = 1.5;
  EXPECT_THROW(SimulatedShip(folder.path() / "heard.bin", options), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "heard.bin"));
}

}  // namespace
}  // namespace fathom::sim

// What CanSource sends on a real CAN interface; runs inside the user-mode Linux (`uml_run --can`).
#include <gmock/gmock.h>

#include <fstream>
#include <map>

#include "firmware_if/devices/can/can_text.hpp"
#include "firmware_if/devices/can/n2k_decoder.hpp"
#include "tests/support/test_data.hpp"
#include "tests/uml/live_bus.hpp"

namespace fathom::uml {
namespace {

using io::CanSource;

class CanSendingOnARealInterface : public ::testing::Test {
 protected:
  void SetUp() override {
    if (::if_nametoindex("vcan1") == 0) GTEST_SKIP() << "no vcan1: run by uml_run --can";
    config_.interface = "vcan1";
    config_.send = true;
    config_.sender.software_version = "1.0";
  }
  io::VehicleReport report() const {
    return io::VehicleReport{.utc_ns = clock_.utcNs(),
                             .latitude = 0.5,
                             .longitude = -1.0,
                             .sigma_horizontal = {},
                             .depth = 20,
                             .altitude = 2,
                             .mission_progress = {}};
  }
  void run(CanSource& source, double seconds) {
    const std::int64_t end = clock_.monotonicNs() + static_cast<std::int64_t>(seconds * 1e9);
    while (clock_.monotonicNs() < end) {
      source.publish(report());
      static_cast<void>(source.poll(10, received_));
    }
  }
  io::CanConfig config_;
  VehicleClock clock_;
  ReceivedSamples received_;
};

TEST_F(CanSendingOnARealInterface, CandumpShowsFramesThatReadBackAsTheReport) {
  const test::TemporaryFolder folder;
  const std::string capture = (folder.path() / "capture.log").string();
  // The shell's child opens its socket before it says so.
  shell("(candump -L vcan1 > " + capture + " & echo $! > " + capture + ".pid); sleep 0.3");
  CanSource source(config_, clock_);
  run(source, 1.5);
  shell("kill $(cat " + capture + ".pid)");

  std::map<std::uint32_t, io::N2kMessage> messages;
  std::uint64_t frames = 0;
  io::N2kDecoder decoder;
  std::ifstream lines(capture);
  for (std::string line; std::getline(lines, line);) {
    io::CanFrame frame;
    ASSERT_EQ(io::parseCandumpLine(line, frame), io::CanLine::kFrame) << line;
    ++frames;
    if (const io::N2kMessage* message = decoder.add(frame))
      messages.insert_or_assign(message->id.pgn, *message);
  }
  EXPECT_EQ(frames, counter(source, "sent"));
  ASSERT_TRUE(messages.contains(129025) && messages.contains(129029) && messages.contains(128267));
  EXPECT_NEAR(*messages[129025].number("latitude_deg"), 28.6478898, 1e-7);
  EXPECT_NEAR(*messages[129029].number("longitude_deg"), -57.29577951308232, 1e-12);
  EXPECT_NEAR(*messages[128267].number("offset_m"), 20, 1e-9);
}

TEST_F(CanSendingOnARealInterface, TwoThatWantOneAddressEndWithTwo) {
  io::CanConfig other_config = config_;
  other_config.sender.name.unique_number = 9;  // a higher NAME: it has to yield
  CanSource source(config_, clock_), other(other_config, clock_);
  for (int i = 0; i < 100; ++i) {
    static_cast<void>(source.poll(5, received_));
    static_cast<void>(other.poll(5, received_));
  }
  EXPECT_EQ(counter(source, "address"), 120U);
  EXPECT_EQ(counter(source, "addresses_lost"), 0U);
  EXPECT_EQ(counter(other, "address"), 121U);
  EXPECT_EQ(counter(other, "addresses_lost"), 1U);
}

TEST_F(CanSendingOnARealInterface, ARequestForClaimsIsAnsweredAndSoIsALaterRivalWithALowerName) {
  CanSource source(config_, clock_);
  BusPeer peer("vcan1");
  run(source, 0.4);
  while (peer.receive(0)) continue;
  const auto receivedId = [&](std::uint32_t id) {
    while (const auto frame = peer.receive(200))
      if (frame->can_id == (id | CAN_EFF_FLAG)) return true;
    return false;
  };
  peer.send(0x18EAFF07U | CAN_EFF_FLAG, {0x00, 0xEE, 0x00});
  run(source, 0.1);
  EXPECT_TRUE(receivedId(0x18EEFF78));
  peer.send(0x18EEFF78U | CAN_EFF_FLAG, {0, 0, 0, 0, 0, 0, 0, 0});
  run(source, 0.4);
  EXPECT_TRUE(receivedId(0x18EEFF79));
  EXPECT_EQ(counter(source, "addresses_lost"), 1U);
}

TEST_F(CanSendingOnARealInterface, ClaimsAgainWhenTheInterfaceIsBack) {
  CanSource source(config_, clock_);
  run(source, 0.1);
  shell("ip link set vcan1 down");
  run(source, 0.1);
  EXPECT_FALSE(source.health().open);
  shell("ip link set vcan1 up");
  BusPeer peer("vcan1");
  run(source, 1.3);
  const auto first = peer.receive(0);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->can_id, 0x18EEFF78U | CAN_EFF_FLAG);
}

}  // namespace
}  // namespace fathom::uml
